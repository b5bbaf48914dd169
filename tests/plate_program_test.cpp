// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Several parts through the programs: what overlaps is refused or joined, copies are arranged.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "ladder.hpp"
#include "program_fixture.hpp"

namespace slicecorr::test {
namespace {

using nlohmann::json;
using testing::HasSubstr;

class PlateProgram : public ProgramFixture {
 protected:
  PlateProgram() {
    write("small.toml",
          "name = \"small\"\n[display]\nwidth_px = 160\nheight_px = 120\npixel_um = 100.0\n[blue]\n"
          "calibration = [[0, 0.0], [255, 100.0]]\n");
    const auto box = [&](const char* name, Point3 low, Point3 high) {
      TriangleMesh mesh;
      add_box(mesh, low, high);
      write_stl(folder_ / name, mesh);
    };
    box("a.stl", {0, 0, 0}, {4, 3, 2});
    box("same.stl", {0, 0, 0}, {4, 3, 2});
    box("beside.stl", {4, 0, 0}, {6, 3, 2});
    box("into.stl", {3, 0, 1}, {6, 3, 2});
  }
  const Command kHow{"--printer", "small.toml", "--layer-um", "100"};
  double volume_ml(const std::string& stack) const {
    return json::parse(good({"info", stack, "--json", "-"}).out)["resin_volume_ml"].get<double>();
  }
  Command slice(Command parts, const Command& more = {}) const {
    parts.insert(parts.begin(), "slice");
    return parts + Command{"-o", "out.uvj"} + kHow + more;
  }
};

TEST_F(PlateProgram, WhatOverlapsIsRefusedOrJoined) {
  const RunResult same =
      bad(2, slice({"a.stl", "same.stl"}), {"a.stl and same.stl overlap", "24 mm³"});
  EXPECT_THAT(same.err, HasSubstr("--overlap join"));
  bad(2, slice({"a.stl", "into.stl"}), {"a.stl and into.stl overlap", "3 mm³", "z = 1.000 mm"});
  good(slice({"a.stl", "beside.stl"}));
  EXPECT_NEAR(volume_ml("out.uvj"), 0.036, 1e-6);
  good(slice({"a.stl", "into.stl"}, {"--overlap", "join"}));
  EXPECT_NEAR(volume_ml("out.uvj"), 0.024 + 0.006, 1e-6);
  bad(2, slice({"a.stl", "same.stl"}, {"--overlap", "perhaps"}), {"--overlap"});
  // A plan looks at parts as they would be printed.
  const Command plan =
      Command{"plan"} + Command{"a.stl", "into.stl"} + kHow + Command{"--resin", "figure-2-2"};
  bad(2, plan, {"--overlap join"});
  EXPECT_NE(call(plan + Command{"--overlap", "join"}).exit_code, 2);
  // The same file twice is two parts, too.
  bad(2, slice({"a.stl", "a.stl"}), {"overlap"});
  bad(2,
      Command{"run", "a.stl", "same.stl", "-o", "run.uvj", "--resin", "figure-2-2", "--speed-mm-h",
              "400"} +
          kHow,
      {"overlap"});
}

TEST_F(PlateProgram, CopiesLieSideBySide) {
  good(slice({"a.stl*6"}));
  EXPECT_NEAR(volume_ml("out.uvj"), 6 * 0.024, 1e-6);
  good(slice({"a.stl", "into.stl", "same.stl"}, {"--arrange", "--spacing-mm", "0.5"}));
  EXPECT_NEAR(volume_ml("out.uvj"), 2 * 0.024 + 0.009, 1e-6);
  const RunResult many =
      bad(2, slice({"a.stl*30"}), {"the parts take 4 plates", "--plates 4", "--spacing-mm"});
  EXPECT_FALSE(std::filesystem::exists(folder_ / "out-1.uvj"));
  good(slice({"a.stl*30"}, {"--plates", "4"}));
  double all = 0;
  for (const char* plate : {"out-1.uvj", "out-2.uvj", "out-3.uvj", "out-4.uvj"})
    all += volume_ml(plate);
  EXPECT_NEAR(all, 30 * 0.024, 1e-6);
  EXPECT_FALSE(std::filesystem::exists(folder_ / "out-5.uvj"));
  bad(2, slice({"a.stl*0"}), {"a.stl*0", "1 to 1000 copies"});
  bad(2, slice({"a.stl*2"}, {"--center-mm", "4,3"}), {"--center-mm"});
  bad(2, slice({"a.stl*no"}), {"a.stl*no"});
  // What counts only for parts that are arranged is not dropped in silence.
  for (const Command& alone :
       {Command{"--spacing-mm", "2"}, Command{"--turn-about-z"}, Command{"--plates", "2"}}) {
    bad(2, slice({"a.stl", "beside.stl"}, alone), {alone.front(), "--arrange"});
  }
  bad(2,
      {"solid", "out-1.uvj", "--design", "a.stl*2", "-o", "x.stl", "--printer", "small.toml",
       "--resin", "figure-2-2", "--speed-mm-h", "400"},
      {"no copies"});
  bad(2,
      Command{"run", "a.stl*2", "-o", "run.uvj", "--resin", "figure-2-2", "--speed-mm-h", "400",
              "--region", "beside.stl=2"} +
          kHow,
      {"--region", "not arranged"});
  good(Command{"run", "a.stl*2", "-o", "run.uvj", "--resin", "figure-2-2", "--speed-mm-h", "400"} +
       kHow);
}

TEST_F(PlateProgram, PartsHaveSizesAndTurnsOfTheirOwn) {
  // Boxes of 4 x 3 x 2 mm: as long as is said, the volume goes with the cube.
  good(slice({"a.stl", "same.stl"}, {"--arrange", "--own-fit-mm", "2,0"}));
  EXPECT_NEAR(volume_ml("out.uvj"), 0.024 / 8 + 0.024, 1e-6);
  good(slice({"a.stl", "same.stl*2"}, {"--own-scale", "0.5,0", "--fit-mm", "6"}));
  // What has no size of its own is as long as all such parts are to be.
  EXPECT_NEAR(volume_ml("out.uvj"), 0.024 / 8 + 2 * 1.5 * 1.5 * 1.5 * 0.024, 1e-6);
  // Upright the first is 4 mm high, which the second alone is not.
  const auto layers = [&] {
    return json::parse(good({"info", "out.uvj", "--json", "-"}).out)["layers"].get<int>();
  };
  good(slice({"a.stl", "same.stl"}, {"--arrange", "--own-rotate-deg", "0,90,0,0,0,0"}));
  EXPECT_EQ(layers(), 40);
  EXPECT_NEAR(volume_ml("out.uvj"), 2 * 0.024, 1e-6);
  good(slice({"a.stl", "same.stl"}, {"--arrange", "--own-rotate-deg", "0,0,90,0,0,0"}));
  EXPECT_EQ(layers(), 20);
  // The same file twice, each by itself: where they lie is said.
  good(slice({"a.stl", "a.stl"}, {"--places-mm", "4,6,10,6", "--own-fit-mm", "2,4"}));
  EXPECT_NEAR(volume_ml("out.uvj"), 0.024 / 8 + 0.024, 1e-6);
  bad(2, slice({"a.stl", "same.stl"}, {"--own-fit-mm", "2"}),
      {"1 own longest side for 2 parts; expected one for each part"});
  bad(2, slice({"a.stl", "same.stl"}, {"--own-rotate-deg", "0,0,90"}), {"three numbers for each"});
  bad(2, slice({"a.stl"}, {"--own-rotate-deg", "0,0,90", "--rotate-deg", "0,0,90"}),
      {"one of them"});
  bad(2, slice({"a.stl"}, {"--own-fit-mm", "2", "--own-scale", "2"}), {"a.stl", "one of them"});
  bad(2, slice({"a.stl"}, {"--own-fit-mm", "2", "--fit-mm", "3"}), {"expected no longest side"});
  bad(2, slice({"a.stl"}, {"--own-fit-mm", "-1"}), {"--own-fit-mm"});
  bad(2,
      Command{"run", "a.stl", "-o", "run.uvj", "--resin", "figure-2-2", "--speed-mm-h", "400",
              "--own-fit-mm", "2", "--leave-alone", "beside.stl"} +
          kHow,
      {"left alone", "no sizes or turns of their own"});
}

}  // namespace
}  // namespace slicecorr::test
