// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Resins with a time to gel through the programs: every look at a stack, fits, derived laws, and what is
/// refused.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <sstream>

#include "ladder.hpp"
#include "page_commands.hpp"
#include "program_fixture.hpp"
#include "slicecorr/process.hpp"

namespace slicecorr::test {
namespace {

using nlohmann::json;
using testing::AllOf;
using testing::HasSubstr;
using testing::Not;

constexpr const char* kResinText =
    "name = \"clear\"\n[cure]\nmodel = \"gel-time\"\nabsorbance_height_um = 600\n"
    "absorbance_base = \"e\"\ngel_a_mj_cm2 = 12\ngel_b_sqrt_mw_cm2_s = 1.2\ndose_factor = 5\n";

class GelTimeProgram : public ProgramFixture {
 protected:
  GelTimeProgram() {
    write_stl(folder_ / "ladder.stl", ladder());
    write("small.toml", kSmallPrinter);
    write("clear.toml", kResinText);
    write("hydrogel.toml",
          "name = \"hydrogel\"\n[cure]\nmodel = \"gel-time\"\nabsorbance_height_um = 8115.88\n"
          "absorbance_base = \"e\"\ngel_a_mj_cm2 = 119.23849\ngel_b_sqrt_mw_cm2_s = 4.8263386\n");
    // Made once: each test gets the same file.
    static const Bytes target = [this] {
      good({"slice", "ladder.stl", "-o", "target.uvj", "--layer-um", "50", "--printer",
            "small.toml"});
      return read_file(folder_ / "target.uvj");
    }();
    write_file(folder_ / "target.uvj", target);
  }
  RunResult resinctl(const Command& arguments) const {
    return run_program(Command{SLICECORR_BIN_DIR "/resinctl"} + arguments, options_);
  }
  const Command kWith{"--printer", "small.toml", "--resin", "clear.toml", "--speed-mm-h", "800"};
};

// A film's skin changes no image with such a law: it is refused before the work, and counts where a print is judged.
TEST_F(GelTimeProgram, SkinsOfFilmsAreRefusedByName) {
  const Command layers{"--printer", "small.toml", "--resin",   "clear.toml",   "--lifts",
                       "each",      "--mode",     "layerwise", "--exposure-s", "3"};
  good(Command{"correct", "target.uvj", "-o", "whole.uvj"} + layers);
  const RunResult r = run_program(Command{SLICECORR_BIN_DIR "/slicecorr", "correct", "target.uvj",
                                          "-o", "skin.uvj", "--skin", "0.9"} +
                                      layers,
                                  options_);
  EXPECT_EQ(r.exit_code, 2) << r.err;
  EXPECT_THAT(r.err, AllOf(HasSubstr("resin 'clear'"), HasSubstr("expected no skin here")));
  EXPECT_FALSE(std::filesystem::exists(folder_ / "skin.uvj"));
  good({"verify", "whole.uvj", "--target", "target.uvj", "--skin", "0.9"});
  EXPECT_THAT(good({"features"}).out,
              HasSubstr("not in corrections for films that hang by a skin (skin): a time to gel"));
}

TEST_F(GelTimeProgram, PrintsAsDesignedAndEverythingLooksAtIt) {
  good(Command{"correct", "target.uvj", "-o", "part.uvj"} + kWith);
  const json after = figures("part.uvj", "target.uvj"),
             before = figures("target.uvj", "target.uvj", kWith);
  EXPECT_EQ(after["cure_through_voxels"], 0);
  EXPECT_EQ(after["undercure_voxels"], 0);
  EXPECT_LT(after["height_error_um"]["max_abs"].get<double>(), 1.0);
  EXPECT_GT(before["cure_through_voxels"].get<double>(), 1000);
  EXPECT_EQ(after["lost_features"], 0);
  EXPECT_EQ(after["split_features"], 0);
  // The dose of the probe is that of the model, and the intensity that of its grey level.
  const RunResult probe =
      good({"probe", "part.uvj", "--x", "80", "--y", "60", "--target", "target.uvj", "--quiet"});
  EXPECT_THAT(probe.out, HasSubstr("slice,z_um,grey,intensity_mw_cm2,phi,dose,target"));
  good({"section", "part.uvj", "--target", "target.uvj", "-o", "section.png"});
  good({"report", "part.uvj", "--target", "target.uvj", "-o", "part.html"});
  good({"solid", "part.uvj", "-o", "printed.stl"});
  good({"info", "part.uvj"});
  const RunResult info = good({"info", "part.uvj", "--json", "-"});
  EXPECT_EQ(json::parse(info.out)["gel_a_mj_cm2"], 60);
  good({"simulate", "part.uvj", "--x", "80", "--y", "60", "-o", "column.svg"});
  good(Command{"compare", "ladder.stl", "--layer-um", "50"} + kWith);
  good(Command{"run", "ladder.stl", "-o", "all.uvj", "--layer-um", "50"} + kWith);
  // Layer by layer, too.
  good(Command{"correct", "target.uvj", "-o", "layers.uvj", "--printer", "small.toml", "--resin",
               "clear.toml", "--mode", "layerwise", "--exposure-s", "3"});
  EXPECT_EQ(figures("layers.uvj", "target.uvj")["undercure_voxels"], 0);
}

TEST_F(GelTimeProgram, CommandsOfItsPageRun) {
  std::filesystem::copy_file(folder_ / "ladder.stl", folder_ / "part.stl");
  auto commands = our_commands(SLICECORR_SOURCE_DIR "/docs/gel-time.md");
  ASSERT_GT(commands.size(), 5U);
  commands.resize(5);  // those that it begins with; fits need measurements
  for (const std::string& line : commands) {
    const RunResult r =
        run_program({"/bin/sh", "-c", "PATH=" SLICECORR_BIN_DIR ":$PATH; " + line}, options_);
    EXPECT_EQ(r.exit_code, 0) << line << r.err;
  }
}

TEST_F(GelTimeProgram, LightThatSpreadsIsCountedAndColumnsAreCorrectedAlone) {
  write("blurred.toml", std::string(kSmallPrinter) + "spread = [[60.0, 1.0]]\n");
  const Command with{"--printer", "blurred.toml", "--resin", "clear.toml", "--speed-mm-h", "800"};
  // A rail a millimetre wide, columns 40 to 59, is an edge of its own to either side: what light two pixels
  // at equal distances from it get adds up to full light and black. Intensities do so, doses would not.
  const auto intensity = [&](int x) {
    const RunResult r = good(
        Command{"probe", "target.uvj", "--x", std::to_string(x), "--y", "60", "--quiet"} + with);
    std::istringstream lines(r.out);
    std::string line, cell;
    for (int row = 0; row < 4; ++row) std::getline(lines, line);
    std::istringstream cells(line);
    for (int column = 0; column < 4; ++column) std::getline(cells, cell, ',');
    return std::stod(cell);
  };
  for (const int away : {0, 1, 2}) {
    EXPECT_NEAR(intensity(40 + away) + intensity(39 - away), 101, 1e-3) << away;
  }
  EXPECT_GT(intensity(40), 51);
  good(Command{"correct", "target.uvj", "-o", "alone.uvj", "--spread-correction", "off"} + with);
  // The same levels as without spread, which are judged by more light than their own.
  good(Command{"correct", "target.uvj", "-o", "sharp.uvj"} + kWith);
  EXPECT_EQ(images("alone.uvj"), images("sharp.uvj"));
  const json alone = figures("alone.uvj", "target.uvj");
  EXPECT_GT(alone["cure_through_voxels"].get<double>(), 0);
  const RunResult r = good(Command{"correct", "target.uvj", "-o", "part.uvj"} + with);
  EXPECT_THAT(r.err, Not(HasSubstr("each column is corrected alone")));
  const json after = figures("part.uvj", "target.uvj");
  EXPECT_TRUE(after.contains("edge_error_in_plane_um"));
  const auto wrong = [](const json& j) {
    return j["cure_through_voxels"].get<double>() + j["undercure_voxels"].get<double>();
  };
  EXPECT_LT(wrong(after), wrong(alone) / 2);
  write("milky.toml", std::string(kResinText) + "scatter_um2_per_um = 0.1\n");
  bad(2,
      {"correct", "target.uvj", "-o", "x.uvj", "--printer", "small.toml", "--resin", "milky.toml",
       "--speed-mm-h", "800"},
      {"scatter_um2_per_um", "gel-time"});
}

TEST_F(GelTimeProgram, ThreadsChangeNothing) {
  good(Command{"correct", "target.uvj", "-o", "one.uvj", "--threads", "1"} + kWith);
  good(Command{"correct", "target.uvj", "-o", "three.uvj", "--threads", "3"} + kWith);
  EXPECT_EQ(read_file(folder_ / "one.uvj"), read_file(folder_ / "three.uvj"));
}

TEST_F(GelTimeProgram, PlanFindsASpeed) {
  const RunResult plan = good(Command{"plan", "target.uvj", "--printer", "small.toml", "--resin",
                                      "clear.toml", "--tolerance-um", "5", "--json", "-"});
  const json j = json::parse(plan.out);
  EXPECT_GT(j["speed_mm_h"].get<double>(), 100);
}

TEST_F(GelTimeProgram, Refusals) {
  const Command correct{"correct",   "target.uvj", "-o",      "x.uvj",
                        "--printer", "small.toml", "--resin", "clear.toml"};
  bad(3, correct + Command{"--speed-mm-h", "20000"}, {"slower than"});
  bad(2, correct + Command{"--speed-mm-h", "800", "--dc-mj-cm3", "100"},
      {"gel-time", "dose factor"});
  // Resin that ends is counted: less of it than full light needs is not enough.
  write("shallow.toml", std::string(kSmallPrinter) + "[vat]\ndepth_um = 50\n");
  bad(3,
      {"correct", "target.uvj", "-o", "x.uvj", "--printer", "shallow.toml", "--resin", "clear.toml",
       "--speed-mm-h", "800"},
      {"the resin is not deep enough", "50 um"});
  bad(2, correct + Command{"--speed-mm-h", "800", "--uncertain", "noise=1%"},
      {"noise", "gel-time"});
  const RunResult sure = good(correct + Command{"--speed-mm-h", "800", "--uncertain", "ha=5%"});
  EXPECT_THAT(sure.err, HasSubstr("how sure, with ha=5%"));
}

TEST_F(GelTimeProgram, DeriveGivesLawsAndFiles) {
  const RunResult r =
      resinctl({"derive", "hydrogel.toml", "--from", "1", "--to", "100", "--json", "-"});
  ASSERT_EQ(r.exit_code, 0) << r.err;
  const json j = json::parse(r.out);
  EXPECT_NEAR(j["m"].get<double>(), 0.93792, 1e-5);
  EXPECT_NEAR(j["critical_dose_prime"].get<double>(), 119.410, 1e-3);
  EXPECT_NEAR(j["worst_error"].get<double>(), 0.054, 5e-4);
  const json wide = json::parse(
      resinctl({"derive", "hydrogel.toml", "--from", "10", "--to", "1000", "--json", "-"}).out);
  EXPECT_NEAR(wide["m"].get<double>(), 0.85030, 1e-5);
  EXPECT_NEAR(wide["critical_dose_prime"].get<double>(), 88.094, 1e-3);
  for (const auto& [as, model] : {std::pair{"jacobs", CureModelKind::jacobs},
                                  {"kinetic", CureModelKind::kinetic},
                                  {"gel-time", CureModelKind::gel_time}}) {
    const std::string file = std::string(as) + "-of-it.toml";
    const RunResult written =
        resinctl({"derive", "hydrogel.toml", "--from", "1", "--to", "100", "--as", as, "-o", file});
    ASSERT_EQ(written.exit_code, 0) << written.err;
    EXPECT_EQ(load_resin(folder_ / file).model, model);
    const RunResult valid = resinctl({"validate", file});
    EXPECT_EQ(valid.exit_code, 0) << valid.err;
  }
  // The range goes with the printer: full light, and what is left of it so deep.
  const json of_printer = json::parse(resinctl({"derive", "clear.toml", "--printer", "small.toml",
                                                "--depth-um", "600", "--json", "-"})
                                          .out);
  EXPECT_NEAR(of_printer["to_mw_cm2"].get<double>(), 100, 1e-9);
  EXPECT_NEAR(of_printer["from_mw_cm2"].get<double>(), 100 / std::exp(1.0), 1e-9);
  for (const Command& wrong :
       {Command{"derive", "hydrogel.toml"},
        Command{"derive", "hydrogel.toml", "--from", "5", "--to", "2"},
        Command{"derive", "figure-2-2", "--from", "1", "--to", "2"},
        Command{"derive", "hydrogel.toml", "--from", "0", "--to", "2"},
        Command{"derive", "hydrogel.toml", "--from", "1", "--to", "100", "-o", "clear.toml"}}) {
    EXPECT_EQ(resinctl(wrong).exit_code, 2) << testing::PrintToString(wrong);
  }
}

TEST_F(GelTimeProgram, FitsTimesAndHeights) {
  write("times.csv", "intensity_mw_cm2,time_s\n1,124.07\n10,13.45\n100,1.675\n1000,0.2719\n");
  const RunResult r = resinctl({"fit", "times.csv", "--model", "gel-time", "--json", "fit.json",
                                "--svg", "fit.svg", "--resin", "clear.toml", "-o", "fitted.toml"});
  ASSERT_EQ(r.exit_code, 0) << r.err;
  const json j = json::parse(to_text(read_file(folder_ / "fit.json")));
  EXPECT_NEAR(j["parameters"]["gel_a_mj_cm2"]["value"].get<double>(), 119.24, 0.05);
  EXPECT_NEAR(load_resin(folder_ / "fitted.toml").gel_a_mj_cm2, 5 * 119.24, 0.3);
  EXPECT_EQ(resinctl({"fit", "times.csv", "--model", "gel-time", "-o", "no.toml"}).exit_code, 2);
  EXPECT_EQ(resinctl({"fit", "times.csv", "--model", "kinetic"}).exit_code, 2);
  write("heights.csv",
        "intensity_mw_cm2,exposure_s,cured_height_um\n"
        "1,200,300\n1,600,880\n10,25,350\n10,80,1010\n100,3,330\n100,10,1000\n100,30,1630\n");
  const RunResult heights =
      resinctl({"fit", "heights.csv", "--model", "gel-time", "-o", "own.toml"});
  ASSERT_EQ(heights.exit_code, 0) << heights.err;
  EXPECT_EQ(load_resin(folder_ / "own.toml").model, CureModelKind::gel_time);
  for (const Command& look :
       {Command{"show", "clear.toml"}, Command{"plot", "clear.toml", "-o", "clear.svg"},
        Command{"plot", "own.toml", "-o", "own.svg"}, Command{"plot", "own.toml", "-o", "own.html"},
        Command{"predict", "--resin", "clear.toml", "--blue-mw-cm2", "20", "--exposure-s", "9",
                "--height-um", "300", "--speed-mm-h", "200"},
        Command{"export", "clear.toml", "--format", "json"}, Command{"validate", "clear.toml"}}) {
    const RunResult seen = resinctl(look);
    EXPECT_EQ(seen.exit_code, 0) << testing::PrintToString(look) << seen.err;
  }
  EXPECT_THAT(resinctl({"show", "clear.toml"}).out,
              AllOf(HasSubstr("12/i + 1.2/sqrt(i)"), HasSubstr("m is")));
}

}  // namespace
}  // namespace slicecorr::test
