// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Resins that bleach through the programs: every look at a stack, a fit, forecasts, and what is refused.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <nlohmann/json.hpp>

#include "ladder.hpp"
#include "program_fixture.hpp"

namespace slicecorr::test {
namespace {

using nlohmann::json;
using testing::AllOf;
using testing::HasSubstr;

constexpr const char* kResinText =
    "name = \"fades\"\n[cure]\nabsorbance_height_um = 180\nabsorbance_base = \"e\"\n"
    "gel_dose_mj_cm2 = 12\ndose_factor = 5\n"
    "[bleaching]\nabsorbance_height_um = 420\nabsorbance_base = \"e\"\ndose_mj_cm2 = 60\n";

class BleachingProgram : public ProgramFixture {
 protected:
  BleachingProgram() {
    write_stl(folder_ / "ladder.stl", ladder());
    write("small.toml", kSmallPrinter);
    write("fades.toml", kResinText);
    good(
        {"slice", "ladder.stl", "-o", "target.uvj", "--layer-um", "50", "--printer", "small.toml"});
  }
  RunResult resinctl(const Command& arguments) const {
    return run_program(Command{SLICECORR_BIN_DIR "/resinctl"} + arguments, options_);
  }
  const Command kWith{"--printer", "small.toml", "--resin", "fades.toml", "--speed-mm-h", "800"};
};

TEST_F(BleachingProgram, SkinsOfFilmsAreRefusedByName) {
  const RunResult r =
      run_program({SLICECORR_BIN_DIR "/slicecorr", "correct", "target.uvj", "-o", "skin.uvj",
                   "--skin", "0.9", "--printer", "small.toml", "--resin", "fades.toml", "--lifts",
                   "each", "--mode", "layerwise", "--exposure-s", "2"},
                  options_);
  EXPECT_EQ(r.exit_code, 2) << r.err;
  EXPECT_THAT(r.err, HasSubstr("expected no skin here"));
  EXPECT_FALSE(std::filesystem::exists(folder_ / "skin.uvj"));
}

TEST_F(BleachingProgram, PrintsAsDesignedAndEverythingLooksAtIt) {
  good(Command{"correct", "target.uvj", "-o", "part.uvj"} + kWith);
  const json after = figures("part.uvj", "target.uvj"),
             before = figures("target.uvj", "target.uvj", kWith);
  EXPECT_EQ(after["cure_through_voxels"], 0);
  EXPECT_EQ(after["undercure_voxels"], 0);
  EXPECT_LT(after["height_error_um"]["max_abs"].get<double>(), 1.0);
  EXPECT_GT(before["cure_through_voxels"].get<double>(), 1000);
  EXPECT_EQ(after["lost_features"], 0);
  good({"probe", "part.uvj", "--x", "80", "--y", "60", "--target", "target.uvj", "--quiet"});
  good({"section", "part.uvj", "--target", "target.uvj", "-o", "section.png"});
  good({"report", "part.uvj", "--target", "target.uvj", "-o", "part.html"});
  good({"solid", "part.uvj", "-o", "printed.stl"});
  const json info = json::parse(good({"info", "part.uvj", "--json", "-"}).out);
  EXPECT_EQ(info["bleaching_dose_mj_cm2"], 60);
  good({"simulate", "part.uvj", "--x", "80", "--y", "60", "-o", "column.svg"});
  good(Command{"compare", "ladder.stl", "--layer-um", "50"} + kWith);
  good(Command{"plan", "ladder.stl", "--layer-um", "50", "--printer", "small.toml", "--resin",
               "fades.toml", "--json", "-"});
  good({"correct", "target.uvj", "-o", "layers.uvj", "--printer", "small.toml", "--resin",
        "fades.toml", "--mode", "layerwise", "--exposure-s", "2"});
  EXPECT_EQ(figures("layers.uvj", "target.uvj")["undercure_voxels"], 0);
}

TEST_F(BleachingProgram, AFitMakesTheResin) {
  // Heights of the resin above, to 0.1 um, by its own law (bleaching_test holds it against another).
  std::string csv = "dose_mj_cm2,cured_height_um\n";
  for (const int dose : {15, 20, 30, 45, 70, 110, 170, 260, 400, 600}) {
    const RunResult one = resinctl({"predict", "--resin", "fades.toml", "--blue-mw-cm2", "10",
                                    "--exposure-s", std::to_string(dose / 10.0), "--json", "-"});
    ASSERT_EQ(one.exit_code, 0) << one.err;
    csv += std::to_string(dose) + "," +
           std::to_string(json::parse(one.out)["cured_height_um"].get<double>()) + "\n";
  }
  write("heights.csv", csv);
  const RunResult fit =
      resinctl({"fit", "heights.csv", "--model", "bleaching", "-o", "found.toml", "--json", "-"});
  ASSERT_EQ(fit.exit_code, 0) << fit.err;
  const json found = json::parse(fit.out);
  EXPECT_THAT(found.dump(), HasSubstr("bleaching_dose_mj_cm2"));
  const RunResult shown = resinctl({"show", "found.toml"});
  ASSERT_EQ(shown.exit_code, 0) << shown.err;
  EXPECT_THAT(shown.out, AllOf(HasSubstr("bleaches"), HasSubstr("420 um base e")));
  EXPECT_EQ(resinctl({"plot", "found.toml", "-o", "found.svg"}).exit_code, 0);
  good({"correct", "target.uvj", "-o", "part.uvj", "--printer", "small.toml", "--resin",
        "found.toml", "--speed-mm-h", "800"});
}

TEST_F(BleachingProgram, WhatIsNotCountedIsRefusedByName) {
  const auto refused = [&](const char* name, const std::string& text, const char* why) {
    write(name, text);
    const RunResult r = call({"correct", "target.uvj", "-o", "x.uvj", "--printer", "small.toml",
                              "--resin", name, "--speed-mm-h", "800"});
    EXPECT_EQ(r.exit_code, 2) << r.err;
    EXPECT_THAT(r.err, AllOf(HasSubstr(name), HasSubstr("bleaching"), HasSubstr(why)));
  };
  const std::string text = kResinText;
  const auto with = [&](std::string from, const std::string& to) {
    std::string out = text;
    out.replace(out.find(from), from.size(), to);
    return out;
  };
  refused("darker.toml", with("um = 420", "um = 90"), "at least that of the fresh resin, 180 um");
  refused("none.toml", with("dose_mj_cm2 = 60", "dose_mj_cm2 = 0"), "dose_mj_cm2");
  refused("nothing.toml", with("dose_mj_cm2 = 60", ""), "dose_mj_cm2");
  refused("power.toml",
          with("gel_dose_mj_cm2 = 12", "model = \"kinetic\"\nm = 0.9\ncritical_dose_prime = 12"),
          "m = 1");
  const RunResult deep =
      call(Command{"correct", "target.uvj", "-o", "x.uvj"} + kWith + Command{"--ha-um", "2000"});
  EXPECT_EQ(deep.exit_code, 2);
  EXPECT_THAT(deep.err, HasSubstr("bleaching.absorbance_height_um"));
  const RunResult sure =
      call(Command{"correct", "target.uvj", "-o", "x.uvj", "--uncertain", "noise=4%"} + kWith);
  EXPECT_EQ(sure.exit_code, 2);
  EXPECT_THAT(sure.err, HasSubstr("bleaches"));
  EXPECT_FALSE(std::filesystem::exists(folder_ / "x.uvj"));
  // Tomographic printing adds light from all sides by Beer's law.
  const RunResult recommend =
      resinctl({"recommend", "--resin", "fades.toml", "--printer", "small.toml", "--layer-um", "50",
                "--speed-mm-h", "800", "--tolerance-um", "20"});
  EXPECT_EQ(recommend.exit_code, 2);
  EXPECT_THAT(recommend.err, HasSubstr("bleaching"));
}

}  // namespace
}  // namespace slicecorr::test
