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
  EXPECT_GE(contrast(speed), 0.05);
  EXPECT_NEAR(contrast(speed), j["at"]["contrast"].get<double>(), 1e-9);
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

TEST_F(PlanProgram, LayerByLayerAndUvLight) {
  const json layers = plan({"--mode", "layerwise", "--ha-um", "110", "--points", "3"});
  // Figure A.7: 0.07837 s just gel a layer.
  EXPECT_NEAR(layers["exposure_s"].get<double>(), 0.07837, 0.0001);
  EXPECT_FALSE(layers.contains("speed_mm_h"));
}

}  // namespace
}  // namespace slicecorr::test
