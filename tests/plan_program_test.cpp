// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// `slicecorr plan` as people run it.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <nlohmann/json.hpp>

#include "ladder.hpp"
#include "program_fixture.hpp"
#include "real_files.hpp"

namespace slicecorr::test {
namespace {

using nlohmann::json;
using testing::HasSubstr;

/// Two tall blocks that are `gap_mm` apart, held by a rail.
TriangleMesh blocks(double gap_mm) {
  TriangleMesh mesh;
  add_box(mesh, {-2, -1, 0}, {-1, 1, 4 + gap_mm});
  add_box(mesh, {-0.95, -1, 0}, {1, 1, 2});
  add_box(mesh, {-0.95, -1, 2 + gap_mm}, {1, 1, 4 + gap_mm});
  return mesh;
}

class PlanProgram : public ProgramFixture {
 protected:
  PlanProgram() {
    write_stl(folder_ / "gap.stl", blocks(0.1));
    write("small.toml", kSmallPrinter);
  }
  json plan(const Command& more) const {
    const RunResult r = good(kPlan + more + Command{"--json", "-", "--quiet"});
    return r.exit_code == 0 ? json::parse(r.out) : json();
  }
  const Command kProcess{"--printer", "small.toml", "--resin", "figure-2-2", "--surface", "slices"};
  const Command kPlan = Command{"plan", "gap.stl", "--layer-um", "50"} + kProcess;
};

TEST_F(PlanProgram, SaysTheFastestSpeedAndTheNextFails) {
  const json j = plan({"--points", "4"});
  const double speed = j["speed_mm_h"];
  EXPECT_LE(speed, 3389.69);
  EXPECT_GE(speed, 3389.69 / 1.01);
  EXPECT_EQ(j["limited_by"], "contrast");
  EXPECT_GE(j["curve"].size(), 5U);
  EXPECT_NEAR(j["gaps"][0]["ranges_mm_h"][0][0].get<double>(), 588.67, 0.005);
  EXPECT_NEAR(j["gaps"][0]["ranges_mm_h"][0][1].get<double>(), 3389.69, 0.005);

  // `correct` and `verify` say the same of the speed, and of the next.
  good(Command{"slice", "gap.stl", "-o", "gap.uvj", "--layer-um", "50", "--printer", "small.toml",
               "--surface", "slices"});
  const auto contrast = [&](double at) {
    good(
        Command{"correct", "gap.uvj", "-o", "out.uvj", "--speed-mm-h", fmt::format("{:.17g}", at)} +
        kProcess);
    return figures("out.uvj", "gap.uvj")["gap_contrast"]["min"].get<double>();
  };
  const double reached = contrast(speed);
  EXPECT_GE(reached, 0.05);
  EXPECT_NEAR(reached, j["at"]["contrast"].get<double>(), 1e-9);
  EXPECT_LT(contrast(j["faster"]["speed_mm_h"]), 0.05);
  // A stack of the design is planned like the mesh.
  const RunResult stack =
      good(Command{"plan", "gap.uvj", "--points", "4", "--json", "-", "--quiet"} + kProcess);
  EXPECT_EQ(json::parse(stack.out)["speed_mm_h"], j["speed_mm_h"]);
}

TEST_F(PlanProgram, TextPictureAndProgress) {
  const RunResult r = good(kPlan + Command{"-o", "plan.svg", "--json", "plan.json"});
  EXPECT_THAT(r.out, HasSubstr("mm/h: the fastest with edges within 25 um"));
  EXPECT_THAT(r.out, HasSubstr("588.67 to 3389.69 mm/h"));
  EXPECT_THAT(r.out, HasSubstr("absorbance height 20 % lower"));
  EXPECT_THAT(r.err, HasSubstr("plan: done"));
  EXPECT_THAT(to_text(read_file(folder_ / "plan.svg")), HasSubstr("<svg"));
  EXPECT_NO_THROW(json::parse(to_text(read_file(folder_ / "plan.json"))));
}

TEST_F(PlanProgram, SameBytesForAnyNumberOfThreads) {
  const RunResult one = good(kPlan + Command{"--json", "-", "--threads", "1"});
  const RunResult two = good(kPlan + Command{"--json", "-", "--threads", "2"});
  EXPECT_EQ(one.out, two.out);
}

TEST_F(PlanProgram, WhatCantBeHadIsRefused) {
  bad(3, kPlan + Command{"--gap-contrast", "0.2"},
      {"100 um (2 slices)", "at most 0.05486", "slices 40 to 41"});
  bad(3, kPlan + Command{"--tolerance-um", "5"}, {"8.68589 um", "greater tolerance"});
  bad(2, kPlan + Command{"--speed-mm-h", "500"}, {"--speed-mm-h is what plan finds"});
  bad(2, kPlan + Command{"--free", "uv"}, {"UV"});
  bad(2, kPlan + Command{"--tolerance-um", "0"}, {"--tolerance-um"});
  bad(2, kPlan + Command{"--tolerance-um", "nan"}, {"--tolerance-um"});
  bad(2, kPlan + Command{"-o", "plan.pdf"}, {".svg"});
  bad(2, kPlan + Command{"--json", "gap.stl"}, {"gap.stl"});
  bad(2, Command{"plan", "none.stl", "--layer-um", "50"} + kProcess, {"none.stl"});
  bad(2, Command{"plan", "gap.stl"} + kProcess, {"--layer-um"});
  good(Command{"slice", "gap.stl", "-o", "gap.uvj", "--layer-um", "50", "--printer", "small.toml"});
  good(Command{"correct", "gap.uvj", "-o", "out.uvj", "--speed-mm-h", "1000"} + kProcess);
  bad(2, Command{"plan", "out.uvj"} + kProcess, {"out.uvj", "corrected"});
}

TEST_F(PlanProgram, WhereNoGapIsPlannedForNothingIsSaidToBeKept) {
  const std::string with = good(kPlan).out;
  EXPECT_THAT(with, HasSubstr("with edges within 25 um"));
  EXPECT_THAT(with, Not(HasSubstr("judged")));
  const std::string without = good(kPlan + Command{"--least-gap-um", "5000"}).out;
  EXPECT_THAT(without, HasSubstr("that prints; no edge at a gap was judged"));
  EXPECT_THAT(without, Not(HasSubstr("keeps all")));
  EXPECT_THAT(without, Not(HasSubstr("edges within")));
}

TEST_F(PlanProgram, SlicesThatPullGoSlower) {
  // A foot of 1 mm below a plate of 4 mm.
  TriangleMesh mesh;
  add_box(mesh, {-0.5, -0.5, 0}, {0.5, 0.5, 3});
  add_box(mesh, {-2, -2, 3}, {2, 2, 4});
  write_stl(folder_ / "plate.stl", mesh);
  const std::string display =
      std::string(kSmallPrinter).substr(std::string("name = \"small\"\n").size());
  write("vat.toml", "name = \"vat\"\nsuction_limit_pa = 2000\n" + display +
                        "[stage]\nmax_speed_mm_h = 9000\nacceleration_mm_s2 = 0.5\n");
  write("change.toml", "name = \"change\"\nsuction_limit_pa = 2000\n" + display +
                           "[stage]\nmax_speed_mm_h = 9000\nacceleration_mm_s2 = 0.5\n"
                           "variable_speed = true\n");
  write(
      "thick.toml",
      "name = \"thick\"\nviscosity_pa_s = 0.3\n[cure]\nabsorbance_height_um = 2000\nabsorbance_base = 10\n"
      "critical_dose_mj_cm3 = 576\n");
  const Command part{"plate.stl",  "--layer-um", "50",    "--resin",
                     "thick.toml", "--surface",  "slices"};
  const auto plan_of = [&](const std::string& printer, const Command& more) {
    return json::parse(
        good(Command{"plan"} + part +
             Command{"--printer", printer, "--json", "-", "--quiet", "--points", "0"} + more)
            .out);
  };
  const json uniform = plan_of("vat.toml", {});
  EXPECT_EQ(uniform["limited_by"], "suction");
  EXPECT_TRUE(uniform["slice_speed_mm_h"].is_null());
  const double bears = uniform["suction"]["speed_limit_mm_h"];
  EXPECT_LE(uniform["speed_mm_h"].get<double>(), bears);
  const json along = plan_of("change.toml", {"--slice-speeds", "speeds.csv"});
  EXPECT_EQ(along["limited_by"], "tolerance");
  const double top = along["speed_mm_h"];
  EXPECT_GT(top, bears);
  const auto& speeds = along["slice_speed_mm_h"];
  ASSERT_EQ(speeds.size(), 81U);
  EXPECT_EQ(speeds[0], top);
  EXPECT_LE(speeds[65].get<double>(), bears);
  EXPECT_NEAR(speeds[65].get<double>(), bears, 0.01 * bears);
  EXPECT_LT(along["print_time_s"].get<double>(), uniform["print_time_s"].get<double>());

  // `correct` takes the table, and refuses its speed without it.
  good(Command{"slice", "plate.stl", "-o", "plate.uvj", "--layer-um", "50", "--printer",
               "change.toml", "--surface", "slices"});
  const Command correct{
      "correct",     "plate.uvj", "-o",         "out.uvj",      "--printer",
      "change.toml", "--resin",   "thick.toml", "--speed-mm-h", fmt::format("{:.17g}", top)};
  bad(3, correct, {"suction_limit_pa"});
  good(correct + Command{"--slice-speed-mm-h", "speeds.csv"});
  bad(2, Command{"plan"} + part + Command{"--printer", "vat.toml", "--slice-speeds", "s.csv"},
      {"variable_speed"});
  write("still.toml", "name = \"still\"\n" + display + "[stage]\nvariable_speed = true\n");
  bad(2, Command{"plan"} + part + Command{"--printer", "still.toml"}, {"acceleration_mm_s2"});
}

TEST_F(PlanProgram, SpeedsByLightGoThroughCorrectVerifyAndSimulate) {
  const std::string display =
      std::string(kSmallPrinter).substr(std::string("name = \"small\"\n").size());
  write("change.toml", "name = \"change\"\n" + display +
                           "[stage]\nmax_speed_mm_h = 9000\nacceleration_mm_s2 = 2\n"
                           "variable_speed = true\n");
  const Command process{"--printer", "change.toml", "--resin", "figure-2-2", "--surface", "slices"};
  const RunResult text = good(Command{"plan", "gap.stl", "--layer-um", "50", "--points", "0",
                                      "--slice-speeds", "speeds.csv", "--json", "plan.json"} +
                              process);
  EXPECT_THAT(text.out, HasSubstr("lamps as they are"));
  EXPECT_THAT(text.out, HasSubstr("--slice-lamps stay"));
  const json j = json::parse(to_text(read_file(folder_ / "plan.json")));
  ASSERT_TRUE(j["along_z"].is_object());
  EXPECT_EQ(j["along_z"]["lamps"], "stay");
  EXPECT_LT(j["print_time_s"].get<double>(), 0.98 * j["along_z"]["uniform_time_s"].get<double>());
  const double most = j["along_z"]["speed_mm_h"];

  good(Command{"slice", "gap.stl", "-o", "gap.uvj", "--layer-um", "50", "--printer", "change.toml",
               "--surface", "slices"});
  const Command correct = Command{"correct",
                                  "gap.uvj",
                                  "-o",
                                  "out.uvj",
                                  "--speed-mm-h",
                                  fmt::format("{:.17g}", most),
                                  "--slice-speed-mm-h",
                                  "speeds.csv"} +
                          process;
  good(correct + Command{"--slice-lamps", "stay"});
  const json stayed = figures("out.uvj", "gap.uvj");
  EXPECT_NEAR(stayed["gap_contrast"]["min"].get<double>(), j["along_z"]["contrast"].get<double>(),
              1e-9);
  EXPECT_NEAR(stayed["height_error_um"]["max_abs"].get<double>(),
              j["along_z"]["max_abs_um"].get<double>(), 1e-6);
  const json info = json::parse(good({"info", "out.uvj", "--json", "-"}).out);
  EXPECT_EQ(info["slice_lamps"], "stay");
  EXPECT_NEAR(info["print_time_s"].get<double>(), j["print_time_s"].get<double>(), 1e-6);
  good({"simulate", "out.uvj", "--x", "8", "--y", "8", "-o", "column.svg"});
  good({"probe", "out.uvj", "--target", "gap.uvj", "--x", "8", "--y", "8"});
  // With lamps that follow, the same speeds are those of another print: the gap is lost there.
  good(Command{"correct", "gap.uvj", "-o", "follow.uvj", "--speed-mm-h",
               fmt::format("{:.17g}", most), "--slice-speed-mm-h", "speeds.csv"} +
       process);
  EXPECT_LT(figures("follow.uvj", "gap.uvj")["gap_contrast"]["min"].get<double>(), 0.05);

  bad(2,
      Command{"correct", "gap.uvj", "-o", "no.uvj", "--speed-mm-h", "1000", "--slice-lamps",
              "stay"} +
          process,
      {"--slice-lamps", "--slice-speed-mm-h"});
}

TEST_F(PlanProgram, TheWayThatPrintsInTheLeastTimeIsChosen) {
  const json j = json::parse(good(kPlan + Command{"--orientations", "0,0,0", "90,0,0", "--points",
                                                  "0", "--json", "-", "--quiet"})
                                 .out);
  ASSERT_EQ(j["orientations"].size(), 2U);
  // On its side the block is 2 mm high and has no gaps between features: it prints sooner.
  EXPECT_FALSE(j["orientations"][0]["chosen"].get<bool>());
  EXPECT_TRUE(j["orientations"][1]["chosen"].get<bool>());
  EXPECT_EQ(j["orientations"][1]["layers"], 40);
  EXPECT_EQ(j["layers"], 40);
  EXPECT_LT(j["print_time_s"].get<double>(), j["orientations"][0]["print_time_s"].get<double>());
  bad(2, kPlan + Command{"--orientations", "0,0"}, {"--orientations '0,0'", "X,Y,Z"});
  bad(2, kPlan + Command{"--orientations", "0,0,0", "--rotate-deg", "1,2,3"}, {"--rotate-deg"});
  bad(3, kPlan + Command{"--orientations", "0,0,0", "0,0,90", "--gap-contrast", "0.2"},
      {"no orientation", "orientation 0,0,0"});
  bad(2, kPlan + Command{"--dose-factors", "0.5"}, {"--dose-factors"});
}

TEST_F(PlanProgram, LayerByLayerAndUvLight) {
  const json layers =
      plan({"--mode", "layerwise", "--lifts", "none", "--ha-um", "110", "--points", "3"});
  // Figure A.7: 0.07837 s just gel a layer.
  EXPECT_NEAR(layers["exposure_s"].get<double>(), 0.07837, 0.0001);
  EXPECT_FALSE(layers.contains("speed_mm_h"));
}

}  // namespace
}  // namespace slicecorr::test
