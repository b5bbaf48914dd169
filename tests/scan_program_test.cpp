// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Scans through the programs: compared with what was printed, tuned by, and the next print corrected; what is refused.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "hook.hpp"
#include "ladder.hpp"
#include "program_fixture.hpp"

namespace slicecorr::test {
namespace {

using nlohmann::json;
using testing::AllOf;
using testing::HasSubstr;

class ScanProgram : public ProgramFixture {
 protected:
  ScanProgram() {
    // Seconds of work; other tests and builds may run beside it.
    options_.timeout = std::chrono::minutes(5);
    write_stl(folder_ / "hook.stl", hook());
    write("small.toml", kSmallPrinter);
    write("believed.toml", resin_text("believed", 600, 576));
    // 6 % higher absorbance height at a light that counts 4 % less.
    write("real.toml", resin_text("real", 636, 576 * 1.04 / 1.06));
    good({"slice", "hook.stl", "-o", "target.uvj", "--layer-um", "50", "--printer", "small.toml"});
    good({"correct", "target.uvj", "-o", "part.uvj", "--printer", "small.toml", "--resin",
          "believed.toml", "--speed-mm-h", "600"});
  }
};

TEST_F(ScanProgram, APrintAsPredictedIsOffByNothing) {
  good({"solid", "part.uvj", "-o", "printed.stl"});
  const RunResult r = good({"scan", "compare", "printed.stl", "--stack", "part.uvj", "--design",
                            "hook.stl", "--json", "-", "--html", "scan.html"});
  const json j = json::parse(r.out);
  ASSERT_EQ(j["deviations"].size(), 2U);
  EXPECT_EQ(j["deviations"][0]["against"], "design");
  EXPECT_EQ(j["deviations"][1]["against"], "predicted");
  EXPECT_EQ(j["unit"], "mm");
  // Coordinates of an STL have 24 bits: 8 mm to 0.5 nm.
  EXPECT_LT(j["deviations"][1]["max_abs_um"].get<double>(), 0.01);
  EXPECT_EQ(j["deviations"][1]["unseen_share"], 0);
  // Walls of pixels of 50 um lie within one of them.
  EXPECT_LT(j["deviations"][0]["p95_abs_um"].get<double>(), 50);
  EXPECT_GT(j["deviations"][0]["mean_abs_um"].get<double>(), 1);
  const std::string page = to_text(read_file(folder_ / "scan.html"));
  EXPECT_THAT(
      page, AllOf(HasSubstr("scan-data"), HasSubstr("class=\"outlines\""), HasSubstr("RoundView")));
  // The design alone.
  const json alone = json::parse(
      good({"scan", "compare", "printed.stl", "--design", "hook.stl", "--json", "-"}).out);
  EXPECT_EQ(alone["posed_by"], "design");
  EXPECT_LT(alone["deviations"][0]["p95_abs_um"].get<double>(), 60);
}

TEST_F(ScanProgram, RefusesWhatIsNoScanOfThatPart) {
  write_stl(folder_ / "ball.stl", sphere(1.9, 4));
  TriangleMesh mirrored = hook();
  for (Point3& v : mirrored.vertices) v[0] = -v[0];
  write_stl(folder_ / "mirrored.stl", inverted(mirrored));
  bad(2, {"scan", "compare", "ball.stl", "--stack", "part.uvj", "--json", "-"},
      {"ball.stl", "another part"});
  bad(2, {"scan", "compare", "mirrored.stl", "--design", "hook.stl", "--html", "a.html"},
      {"mirror image"});
  bad(2, {"scan", "compare", "ball.stl"}, {"nothing to measure against"});
  bad(2, {"scan", "compare", "ball.stl", "--design", "hook.stl", "--voxel-um", "20"},
      {"no volume"});
  bad(2, {"scan", "compare", "hook.stl", "--design", "hook.stl", "--scan-unit", "m"},
      {"another part"});
  write("few.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\n");
  bad(2, {"scan", "compare", "few.obj", "--design", "hook.stl"}, {"few.obj", "3 points"});
  bad(2, {"tune", "--scan", "ball.stl", "--printer", "small.toml", "--resin", "believed.toml"},
      {"--stack"});
  bad(2,
      {"tune", "--stack", "part.uvj", "--printer", "small.toml", "--resin", "believed.toml", "-o",
       "tuned.toml"},
      {"needs a scan", "--scan"});
  bad(2,
      {"tune", "--scan", "ball.stl", "--stack", "target.uvj", "--printer", "small.toml", "--resin",
       "believed.toml"},
      {"no corrected stack"});
}

// Before anything is printed: a hook tells height and light, a plain block does not.
TEST_F(ScanProgram, SaysWhatScansWouldTell) {
  write_stl(folder_ / "block.stl", box({0, 0, 0}, {1.5, 1.5, 1.5}));
  good({"run", "block.stl", "-o", "block.uvj", "--resin", "believed.toml", "--speed-mm-h", "600",
        "--layer-um", "50", "--printer", "small.toml"});
  const RunResult r = good({"tune", "--stack", "part.uvj", "block.uvj", "--printer", "small.toml",
                            "--resin", "believed.toml", "--sigma-um", "5"});
  EXPECT_THAT(r.out, AllOf(HasSubstr("points 5 um off"), HasSubstr("part         block"),
                           HasSubstr("block would not tell apart")));
  const std::size_t at = r.out.find("\nabsorbance height, %");
  ASSERT_NE(at, std::string::npos) << r.out;
  const std::string line = r.out.substr(at + 1, r.out.find('\n', at + 1) - at - 1);
  double before = 0, after = 0;
  EXPECT_EQ(std::sscanf(line.c_str(), "absorbance height, %% %lf %lf", &before, &after), 2) << line;
  EXPECT_NEAR(before, 19.6, 0.1);
  EXPECT_LT(after, 5);
  EXPECT_THAT(line, testing::EndsWith("not told"));
}

TEST_F(ScanProgram, AScanMakesTheNextPrintRight) {
  good({"solid", "part.uvj", "-o", "printed.ply", "--resin", "real.toml"});
  const RunResult r =
      good({"tune", "--scan", "printed.ply", "--stack", "part.uvj", "--printer", "small.toml",
            "--resin", "believed.toml", "-o", "tuned.toml", "--printer-out", "tuned-printer.toml",
            "--next", "part2.uvj", "--target", "target.uvj"});
  EXPECT_THAT(r.out,
              AllOf(HasSubstr("absorbance height"), HasSubstr("expected, as edges along z")));
  const auto off = [&](const std::string& stack) {
    return figures(stack, "target.uvj",
                   {"--printer", "small.toml", "--resin", "real.toml", "--speed-mm-h",
                    "600"})["height_error_um"]["mean_abs"]
        .get<double>();
  };
  const double first = off("part.uvj"), second = off("part2.uvj");
  EXPECT_GT(first, 3);
  EXPECT_LT(second, 0.25 * first) << r.out;
}

}  // namespace
}  // namespace slicecorr::test
