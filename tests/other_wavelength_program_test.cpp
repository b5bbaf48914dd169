// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// A resin of another wavelength than the printer's light, and a tuned resin with another printer, through
/// the programs: refused by name of both, taken where that is asked for, and told wherever figures are.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <sstream>

#include "ladder.hpp"
#include "program_fixture.hpp"

namespace slicecorr::test {
namespace {

using nlohmann::json;
using testing::AllOf;
using testing::HasSubstr;
using testing::Not;

constexpr const char* kTold = "resin 'goo' was measured at 365 nm";
constexpr const char* kFlag = "--other-wavelength";

std::string printer_text(const std::string& name, const std::string& light) {
  return "name = \"" + name +
         "\"\n[display]\nwidth_px = 160\nheight_px = 120\npixel_um = 50.0\n[blue]\n" + light +
         "calibration = [[0, 0.1], [255, 100.0]]\n";
}

class OtherWavelengthProgram : public ProgramFixture {
 protected:
  OtherWavelengthProgram() {
    write_stl(folder_ / "ladder.stl", ladder());
    write("violet.toml", printer_text("violet", "wavelength_nm = 405\n"));
    write("unknown.toml", printer_text("unknown", ""));
    write("goo.toml",
          "name = \"goo\"\n[cure]\nwavelength_nm = 365\nabsorbance_height_um = 400\n"
          "absorbance_base = 10\ngel_dose_mj_cm3 = 100\nviscosity_pa_s = 0.5\n");
    write("plain.toml",
          "name = \"plain\"\n[cure]\nabsorbance_height_um = 400\nabsorbance_base = 10\n"
          "gel_dose_mj_cm3 = 100\n");
    good({"slice", "ladder.stl", "-o", "target.uvj", "--layer-um", "50", "--printer",
          "violet.toml"});
  }
  RunResult program(const char* name, const Command& arguments) const {
    return run_program(Command{std::string(SLICECORR_BIN_DIR "/") + name} + arguments, options_);
  }
  const Command kPair{"--printer", "violet.toml", "--resin", "goo.toml"};
  const Command kSpeed{"--speed-mm-h", "800"};
  const Command kPart{"ladder.stl", "--layer-um", "50"};
};

TEST_F(OtherWavelengthProgram, IsRefusedByNameOfBoth) {
  const std::vector<std::string> words{"resin 'goo'", "365 nm", "printer 'violet'", "405 nm",
                                       kFlag};
  bad(2, Command{"correct", "target.uvj", "-o", "x.uvj"} + kPair + kSpeed, words);
  bad(2, Command{"run"} + kPart + Command{"-o", "x.uvj"} + kPair + kSpeed, words);
  bad(2, Command{"verify", "target.uvj", "--target", "target.uvj"} + kPair + kSpeed, words);
  bad(2, Command{"compare"} + kPart + kPair + kSpeed, words);
  bad(2, Command{"plan"} + kPart + kPair, words);
  bad(2, Command{"flow"} + kPart + kPair + kSpeed, words);
  bad(2,
      Command{"correct", "target.uvj", "-o", "x.uvj"} + kPair + kSpeed +
          Command{"--other-wavelength=refuse"},
      words);
  for (const Command& question :
       {Command{"predict", "--exposure-s", "2"} + kPair,
        Command{"recommend", "--speed-mm-h", "500", "--tolerance-um", "20"} + kPair}) {
    const RunResult r = program("resinctl", question);
    EXPECT_EQ(r.exit_code, 2) << r.err;
    for (const std::string& word : words) EXPECT_THAT(r.err, HasSubstr(word));
    EXPECT_EQ(r.out, "");
  }
  const RunResult post = program("slicecorr-post", kPair + kSpeed + Command{"target.uvj"});
  EXPECT_EQ(post.exit_code, 2) << post.err;
  EXPECT_THAT(post.err, AllOf(HasSubstr("resin 'goo'"), HasSubstr("printer 'violet'")));
  const RunResult farm =
      program("slicefarm", Command{"submit"} + kPart + kPair + kSpeed + Command{"--dir", "night"});
  EXPECT_EQ(farm.exit_code, 2) << farm.err;
  EXPECT_THAT(farm.err, AllOf(HasSubstr("resin 'goo'"), HasSubstr("printer 'violet'")));
  // Words of the option are looked at.
  const RunResult wrong = call(Command{"correct", "target.uvj", "-o", "x.uvj"} + kPair + kSpeed +
                               Command{"--other-wavelength=maybe"});
  EXPECT_EQ(wrong.exit_code, 2);
  EXPECT_THAT(wrong.err, HasSubstr("maybe"));
}

TEST_F(OtherWavelengthProgram, IsTakenAndToldEverywhere) {
  // The flag takes nothing that stands behind it.
  const RunResult corrected =
      good(Command{"correct"} + Command{kFlag, "target.uvj", "-o", "part.uvj"} + kPair + kSpeed);
  EXPECT_THAT(corrected.err, AllOf(HasSubstr(kTold), HasSubstr("405 nm")));
  // The stack says it of itself; nothing needs to be said again, and nothing is refused.
  const RunResult verified = good({"verify", "part.uvj", "--target", "target.uvj", "--json", "-"});
  EXPECT_THAT(verified.err, HasSubstr(kTold));
  const json expected = {{"printer_nm", 405.0}, {"resin_nm", 365.0}};
  EXPECT_EQ(json::parse(verified.out)["other_wavelength"], expected);
  EXPECT_THAT(good({"info", "part.uvj"}).out, HasSubstr(kTold));
  const json info = json::parse(good({"info", "part.uvj", "--json", "-"}).out);
  EXPECT_EQ(info["other_wavelength"], expected);
  EXPECT_EQ(info["wavelength_nm"], 405.0);
  EXPECT_EQ(info["resin_wavelength_nm"], 365.0);
  good({"report", "part.uvj", "--target", "target.uvj", "-o", "page.html"});
  EXPECT_THAT(to_text(read_file(folder_ / "page.html")), HasSubstr("was measured at 365 nm"));
  // Another printer for the stack is looked at anew.
  write("other.toml", printer_text("other", "wavelength_nm = 385\n"));
  bad(2, {"verify", "part.uvj", "--target", "target.uvj", "--printer", "other.toml"},
      {"goo", "other", "385 nm"});

  const RunResult run =
      good(Command{"run"} + kPart + Command{"-o", "run.uvj", kFlag} + kPair + kSpeed);
  EXPECT_THAT(run.err, HasSubstr(kTold));
  EXPECT_EQ(json::parse(to_text(read_file(folder_ / "run.json")))["other_wavelength"], expected);
  EXPECT_THAT(good(Command{"compare"} + kPart + kPair + kSpeed + Command{kFlag}).err,
              HasSubstr(kTold));
  const RunResult plan = good(Command{"plan", "--json", "-"} + kPart + kPair + Command{kFlag});
  EXPECT_THAT(plan.err, HasSubstr(kTold));
  EXPECT_EQ(json::parse(plan.out)["other_wavelength"], expected);
  EXPECT_THAT(good(Command{"flow"} + kPart + kPair + kSpeed + Command{kFlag}).err,
              HasSubstr(kTold));
  const RunResult forecast =
      program("resinctl", Command{"predict", "--exposure-s", "2", kFlag} + kPair);
  EXPECT_EQ(forecast.exit_code, 0) << forecast.err;
  EXPECT_THAT(forecast.err, HasSubstr(kTold));
  write_file(folder_ / "post.uvj", read_file(folder_ / "target.uvj"));
  const RunResult post =
      program("slicecorr-post", Command{kFlag} + kPair + kSpeed + Command{"post.uvj"});
  EXPECT_EQ(post.exit_code, 0) << post.err;
  EXPECT_THAT(post.err, HasSubstr(kTold));
}

TEST_F(OtherWavelengthProgram, TheFarmTakesItAndItsLogTellsIt) {
  const RunResult submitted = program(
      "slicefarm", Command{"submit"} + kPart + kPair + kSpeed + Command{kFlag, "--dir", "night"});
  ASSERT_EQ(submitted.exit_code, 0) << submitted.err;
  // Who submits is told as well as who reads the log.
  EXPECT_THAT(submitted.err, HasSubstr(kTold));
  const RunResult ran = program("slicefarm", {"run", "--until-empty", "--dir", "night"});
  ASSERT_EQ(ran.exit_code, 0) << ran.err;
  EXPECT_THAT(program("slicefarm", {"logs", "1", "--dir", "night"}).out, HasSubstr(kTold));
}

TEST_F(OtherWavelengthProgram, WhatIsNotKnownIsToldAndNotRefused) {
  const Command no_light{"--printer", "unknown.toml", "--resin", "goo.toml"};
  EXPECT_THAT(good(Command{"correct", "target.uvj", "-o", "a.uvj"} + no_light + kSpeed).err,
              AllOf(HasSubstr(kTold), HasSubstr("printer 'unknown'")));
  const Command no_resin{"--printer", "violet.toml", "--resin", "plain.toml"};
  EXPECT_THAT(good(Command{"correct", "target.uvj", "-o", "b.uvj"} + no_resin + kSpeed).err,
              AllOf(HasSubstr("printer 'violet' has 405 nm"), HasSubstr("resin 'plain'")));
  const Command neither{"--printer", "unknown.toml", "--resin", "plain.toml"};
  EXPECT_THAT(good(Command{"correct", "target.uvj", "-o", "c.uvj"} + neither + kSpeed).err,
              Not(HasSubstr("measured")));
  // Lights that differ by what lamps of one kind do are one light, and nothing is told.
  write("near.toml", printer_text("near", "wavelength_nm = 375\n"));
  const RunResult near = good(Command{"correct", "target.uvj", "-o", "d.uvj", "--printer",
                                      "near.toml", "--resin", "goo.toml"} +
                              kSpeed);
  EXPECT_THAT(near.err, Not(HasSubstr("measured")));
  const json info = json::parse(good({"info", "d.uvj", "--json", "-"}).out);
  EXPECT_FALSE(info.contains("other_wavelength"));
}

TEST_F(OtherWavelengthProgram, ATunedResinIsRefusedWithThePrinterOfBefore) {
  write("mine.toml", printer_text("mine", "wavelength_nm = 405\n"));
  good({"testpart", "staircase", "--printer", "mine.toml", "--resin", "plain.toml", "-o",
        "stairs.uvj"});
  // What prints is measured: heights of Jacobs' law, of resin that is 5 % higher than its file says.
  std::istringstream table(to_text(read_file(folder_ / "stairs.csv")));
  std::string filled;
  std::size_t row = 0;
  for (std::string line; std::getline(table, line);) {
    std::istringstream cells(line);
    std::string name, light, seconds;
    if (line.starts_with("plug ") && std::getline(cells, name, ',') &&
        std::getline(cells, light, ',') && std::getline(cells, seconds, ',')) {
      const double height_um = 400 / std::log(10.0), areal_mj_cm2 = 100 * height_um * 1e-4;
      line += std::to_string(1.05 * height_um *
                             std::log(std::stod(light) * std::stod(seconds) / areal_mj_cm2));
      ++row;
    }
    filled += line + "\n";
  }
  ASSERT_GT(row, 4U) << filled;
  write("stairs.csv", filled);
  const RunResult tuned = program("resinctl", {"tune", "stairs.csv", "--printer", "mine.toml",
                                               "--resin", "plain.toml", "-o", "tuned.toml"});
  ASSERT_EQ(tuned.exit_code, 0) << tuned.err << filled;
  const Command resin{"--resin", "tuned.toml"};
  good(Command{"correct", "target.uvj", "-o", "a.uvj", "--printer", "tuned-printer.toml"} + resin +
       kSpeed);
  for (const Command& more : {Command{}, Command{kFlag}}) {
    bad(2,
        Command{"correct", "target.uvj", "-o", "x.uvj", "--printer", "mine.toml"} + resin + kSpeed +
            more,
        {"resin 'tuned'", "was tuned with the printer 'tuned-printer",
         "this is the printer 'mine"});
  }
  // The stack keeps it: another printer is refused later, too.
  bad(2, {"verify", "a.uvj", "--target", "target.uvj", "--printer", "mine.toml"},
      {"resin 'tuned'", "'mine"});
  good({"verify", "a.uvj", "--target", "target.uvj"});
  const RunResult forecast = program(
      "resinctl", Command{"predict", "--exposure-s", "2", "--printer", "mine.toml"} + resin);
  EXPECT_EQ(forecast.exit_code, 2) << forecast.err;
}

}  // namespace
}  // namespace slicecorr::test
