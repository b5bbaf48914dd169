// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// `resinctl chemistry` and `slicecorr pattern` as people run them.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>

#include "page_commands.hpp"
#include "program_fixture.hpp"
#include "resins_text.hpp"
#include "slicecorr/stack.hpp"

namespace slicecorr::test {
namespace {

using nlohmann::json;
using testing::HasSubstr;

const std::string kHydrogel = SLICECORR_DB_DIR "/model-hydrogel.toml";

class ChemistryProgram : public ProgramFixture {
 protected:
  RunResult resinctl(const Command& arguments) const {
    return run_program(Command{SLICECORR_BIN_DIR "/resinctl"} + arguments, options_);
  }
  RunResult pattern(const Command& arguments) const {
    return run_program(Command{SLICECORR_BIN_DIR "/slicecorr", "pattern"} + arguments, options_);
  }
  std::string text_of(const std::string& name) const {
    std::ifstream in(
        name[0] == '/' ? std::filesystem::path(name) : std::filesystem::path(folder_.path()) / name,
        std::ios::binary);
    std::stringstream text;
    text << in.rdbuf();
    return text.str();
  }
  /// 64 x 64 pixels with five squares, of 5 um.
  void write_squares() const {
    GreyImage image;
    image.width_px = image.height_px = 64;
    image.pixels.assign(64 * 64, 0);
    const double squares[5][3] = {
        {80, 80, 100}, {240, 80, 50}, {80, 240, 30}, {240, 240, 50}, {180, 240, 30}};
    for (const auto& q : squares) {
      for (int y = 0; y < 64; ++y) {
        for (int x = 0; x < 64; ++x) {
          if (std::abs(x * 5 + 2.5 - q[0]) < q[2] / 2 && std::abs(y * 5 + 2.5 - q[1]) < q[2] / 2) {
            image.pixels[static_cast<std::size_t>(y * 64 + x)] = 255;
          }
        }
      }
    }
    const std::vector<std::uint8_t> png = encode_png(image);
    write("squares.png", std::string(png.begin(), png.end()));
  }
};

TEST_F(ChemistryProgram, SaysTimesAndDrawsThem) {
  const RunResult r =
      resinctl({"chemistry", kHydrogel, "--intensity-mw-cm2", "100", "--json", "-", "--csv",
                "cell.csv", "-o", "cell.svg", "--light", "100:1.6", "0:1"});
  ASSERT_EQ(r.exit_code, 0) << r.err;
  const json j = json::parse(r.out);
  EXPECT_NEAR(j["t_inh_s"].get<double>(), 1.192963, 1e-5);
  EXPECT_NEAR(j["t_gel_s"].get<double>(), 1.67257, 1e-4);
  EXPECT_NEAR(j["A"].get<double>(), 119.238, 1e-3);
  EXPECT_NEAR(j["B"].get<double>(), 4.82633, 1e-4);
  EXPECT_NEAR(j["m"].get<double>(), 0.85593, 1e-5);
  EXPECT_NEAR(j["closed"]["t_gel_s"].get<double>(), 1.67502, 1e-5);
  expect_sound_svg(text_of("cell.svg"));
  const std::string csv = text_of("cell.csv");
  EXPECT_EQ(csv.rfind("time_s,intensity_mw_cm2,", 0), 0U);
  EXPECT_NE(csv.find("\n2.6,0,"), std::string::npos);
}

TEST_F(ChemistryProgram, CommandsOfItsPageRun) {
  write_squares();
  std::filesystem::copy_file(std::filesystem::path(folder_.path()) / "squares.png",
                             std::filesystem::path(folder_.path()) / "mask.png");
  const std::string page = SLICECORR_SOURCE_DIR "/docs/chemistry.md";
  std::vector<std::string> commands = page_commands(page, "resinctl chemistry");
  ASSERT_EQ(commands.size(), 2U);
  for (const std::string& line : page_commands(page, "slicecorr pattern")) {
    commands.push_back(line);
  }
  EXPECT_EQ(commands.size(), 4U);
  for (const std::string& line : commands) {
    const RunResult r =
        run_program({"/bin/sh", "-c", "PATH=" SLICECORR_BIN_DIR ":$PATH; " + line}, options_);
    EXPECT_EQ(r.exit_code, 0) << line << r.err;
  }
}

TEST_F(ChemistryProgram, RefusesWhatNeverGels) {
  RunResult r = resinctl({"chemistry", kHydrogel, "--intensity-mw-cm2", "1",
                          "--oxygen-supply-per-s", "0.1", "--json", "-"});
  EXPECT_EQ(r.exit_code, 3);
  EXPECT_THAT(r.err, HasSubstr("more than 11.92 mW/cm²"));
  EXPECT_TRUE(json::parse(r.out)["t_gel_s"].is_null());
  std::string scarce = text_of(kHydrogel);
  const std::string key = "initiator_mol_l = 0.133779";
  scarce.replace(scarce.find(key), key.size(), "initiator_mol_l = 1e-4");
  write("model-hydrogel.toml", scarce);
  r = resinctl({"chemistry", "model-hydrogel.toml", "--intensity-mw-cm2", "100"});
  EXPECT_EQ(r.exit_code, 3);
  EXPECT_THAT(r.err, HasSubstr("more than 0.00013 mol/l"));
  r = resinctl({"chemistry", "figure-2-2", "--intensity-mw-cm2", "100"});
  EXPECT_EQ(r.exit_code, 2);
  EXPECT_THAT(r.err, HasSubstr("expected a table with the resin's chemistry"));
  r = resinctl({"chemistry", kHydrogel, "--intensity-mw-cm2", "100", "--light", "5"});
  EXPECT_EQ(r.exit_code, 2);
  EXPECT_THAT(r.err, HasSubstr("100:1.6"));
}

TEST_F(ChemistryProgram, CorrectsAnImageAndJudgesIt) {
  write_squares();
  const RunResult r = pattern(
      {"squares.png",   "--pixel-um", "5",         "--resin",     kHydrogel,   "--intensity-mw-cm2",
       "1000",          "--time-s",   "1.2",       "--spread-um", "8",         "--correct",
       "corrected.png", "-o",         "times.png", "--curve",     "curve.svg", "--csv",
       "cells.csv",     "--json",     "-"});
  ASSERT_EQ(r.exit_code, 0) << r.err;
  const json j = json::parse(r.out);
  EXPECT_GT(j["jaccard"]["best"].get<double>(), 0.998);
  EXPECT_LT(j["jaccard_even"]["best"].get<double>(), 0.98);
  EXPECT_EQ(j["lit_cells"], 400 + 100 + 36 + 100 + 36);
  EXPECT_LT(j["balance_error"].get<double>(), 1e-10);
  EXPECT_THAT(r.err, HasSubstr("MiB"));
  expect_sound_svg(text_of("curve.svg"));
  // The same map as SVG, whose words can be read.
  ASSERT_EQ(pattern({"corrected.png", "--pixel-um", "5", "--resin", kHydrogel, "--intensity-mw-cm2",
                     "1000", "--time-s", "0.6", "-o", "map.svg"})
                .exit_code,
            0);
  const std::string map = text_of("map.svg");
  EXPECT_EQ(map.rfind("<svg ", 0), 0U);
  EXPECT_THAT(map, HasSubstr("gels at"));
  EXPECT_THAT(map, HasSubstr("100 um"));
  const std::string cells = text_of("cells.csv");
  EXPECT_EQ(std::count(cells.begin(), cells.end(), '\n'), 64 * 64 + 1);
  EXPECT_TRUE(std::filesystem::exists(std::filesystem::path(folder_.path()) / "corrected.png"));
  EXPECT_TRUE(std::filesystem::exists(std::filesystem::path(folder_.path()) / "times.png"));
}

TEST_F(ChemistryProgram, PatternsThatDoNotFitAreRefused) {
  write_squares();
  const Command good{"squares.png", "--pixel-um", "5", "--resin", kHydrogel, "--intensity-mw-cm2"};
  RunResult r = pattern(good + Command{"100", "--time-s", "1"});
  EXPECT_EQ(r.exit_code, 3);
  EXPECT_THAT(r.err, HasSubstr("even light takes 1.675 s"));
  r = pattern(good + Command{"100", "--time-s", "2", "--step-ms", "30"});
  EXPECT_EQ(r.exit_code, 2);
  EXPECT_THAT(r.err, HasSubstr("dx²/4D"));
  r = pattern(good + Command{"1000", "--time-s", "1", "--spread-um", "8", "--correct", "c.png",
                             "--oxygen-used-up-by-s", "0.15"});
  EXPECT_EQ(r.exit_code, 3);
  EXPECT_THAT(r.err, HasSubstr("mW/cm² would"));
  EXPECT_FALSE(std::filesystem::exists(std::filesystem::path(folder_.path()) / "c.png"));
  r = pattern(good + Command{"100", "--time-s", "2", "-o", "map.jpg"});
  EXPECT_EQ(r.exit_code, 2);
  EXPECT_THAT(r.err, HasSubstr(".png or .svg"));
  r = pattern(good + Command{"-5", "--time-s", "1"});
  EXPECT_EQ(r.exit_code, 2);
  r = pattern({"no.png", "--pixel-um", "5", "--resin", kHydrogel, "--intensity-mw-cm2", "1",
               "--time-s", "1"});
  EXPECT_EQ(r.exit_code, 2);
  r = pattern({"squares.png", "--pixel-um", "5", "--resin", SLICECORR_DB_DIR "/figure-2-2.toml",
               "--intensity-mw-cm2", "1", "--time-s", "1"});
  EXPECT_EQ(r.exit_code, 2);
  EXPECT_THAT(r.err, HasSubstr("[chemistry]"));
}

}  // namespace
}  // namespace slicecorr::test
