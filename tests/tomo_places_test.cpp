// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Parts beside the axis, above the optical axis, and several in one vial.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "run_program.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/tomo/print.hpp"
#include "stack_fixture.hpp"
#include "tomo_definitions.hpp"
#include "tomo_jobs.hpp"

namespace slicecorr::tomo {
namespace {

using testing::HasSubstr;

std::string off_of(const TriangleMesh& mesh) {
  std::string text = fmt::format("OFF\n{} {} 0\n", mesh.vertices.size(), mesh.triangles.size());
  for (const Point3& v : mesh.vertices) text += fmt::format("{} {} {}\n", v[0], v[1], v[2]);
  for (const auto& t : mesh.triangles) text += fmt::format("3 {} {} {}\n", t[0], t[1], t[2]);
  return text;
}

/// Coverage of a box with these corners in the voxel with this middle.
double share_of(const Point3& low, const Point3& high, double x, double y, double side) {
  const auto along = [&](double at, std::size_t k) {
    return std::max(0.0, std::min(at + side / 2, high[k]) - std::max(at - side / 2, low[k])) / side;
  };
  return along(x, 0) * along(y, 1);
}

TEST(TomoPartPlaces, PartsLieWhereTheyAreSaidToLie) {
  const Printer printer = bench_printer();
  const double h = 0.25;
  // Their own coordinates are far away.
  std::vector<PlacedPart> parts;
  parts.push_back({"a", box_mesh({90, 90, 5}, {91, 92, 6}), {1.3, -0.6, 2.0}, false});
  parts.push_back({"b", box_mesh({0, 0, 0}, {1.5, 1, 2}), {-1.5, 0.5, 0.5}, true});
  const PlacedVoxels all = voxelise(parts, printer, h);
  const Point3 low_a{0.8, -1.6, 1.5}, high_a{1.8, 0.4, 2.5}, low_b{-2.25, 0, 0.5},
      high_b{-0.75, 1, 2.5};
  ASSERT_EQ(all.part.nz, 8);
  EXPECT_NEAR(all.middle_z_mm, 1.5, 1e-12);
  const Sampling sampling{.voxel_mm = h, .slices = 8, .middle_z_mm = all.middle_z_mm};
  EXPECT_NEAR(sampling.z_mm(0), 0.625, 1e-12);
  const int n = all.part.nx;
  for (int z = 0; z < 8; ++z) {
    for (int y = 0; y < n; ++y) {
      for (int x = 0; x < n; ++x) {
        const double at_x = (x - n / 2) * h, at_y = (y - n / 2) * h;
        double share = share_of(low_b, high_b, at_x, at_y, h);
        if (sampling.z_mm(z) > low_a[2]) share += share_of(low_a, high_a, at_x, at_y, h);
        ASSERT_NEAR(all.part.values[all.part.at(z, y, x)], 255 * share, 1.01)
            << x << ' ' << y << ' ' << z;
      }
    }
  }
  // They touch: no overlap. A hundredth farther they do.
  parts[0].at_mm = {-0.25, -0.6, 2.0};
  parts[1].at_mm = {-1.5, 0.5, 0.5};
  EXPECT_NO_THROW(voxelise(parts, printer, h));
  parts[0].at_mm[0] = -0.6;
  try {
    voxelise(parts, printer, h);
    FAIL();
  } catch (const InputError& e) {
    EXPECT_THAT(e.what(), HasSubstr("a and b overlap"));
  }
  parts[0].at_mm[0] = 3.5;
  try {
    voxelise(parts, printer, h);
    FAIL();
  } catch (const InputError& e) {
    EXPECT_THAT(e.what(), HasSubstr("a: the part reaches 4.308 mm from the axis"));
  }
  const Box<std::uint8_t> dot{1, 3, 3, {0, 0, 0, 0, 255, 0, 0, 0, 0}};
  const Box<std::uint8_t> moved = placed(dot, printer, h, {0.5, -0.75});
  EXPECT_EQ(moved.values[moved.at(0, n / 2 - 3, n / 2 + 2)], 255);
  EXPECT_THROW(placed(dot, printer, h, {0.3, 0}), InputError);
  EXPECT_THROW(placed(dot, printer, h, {0, 4.25}), InputError);
}

class TomoPlacesProgram : public testing::Test {
 protected:
  void SetUp() override {
    write("bench.toml", test::bench_printer_toml());
    write("resin.toml", test::bench_resin_toml("2.5"));
    write("a.off", off_of(box_mesh({0, 0, 0}, {1, 1, 1})));
    write("b.off", off_of(box_mesh({0, 0, 0}, {0.75, 1.25, 0.5})));
  }
  void write(const std::string& name, const std::string& text) {
    test::write_file(folder_ / name, test::to_bytes(text));
  }
  test::RunResult call(std::vector<std::string> words) const {
    test::RunOptions options;
    options.folder = folder_.path();
    words.insert(words.begin(), {SLICECORR_BIN_DIR "/slicecorr", "--quiet", "tomo"});
    return test::run_program(words, options);
  }
  test::RunResult solve(std::vector<std::string> parts, const std::string& printer = "bench.toml") {
    parts.insert(parts.begin(), "solve");
    parts.insert(parts.end(),
                 {"--voxel-mm", "0.25", "--printer", printer, "--resin", "resin.toml", "-o",
                  "o.frames", "--angles", "48", "--iterations", "20", "--json", "-"});
    return call(parts);
  }
  test::TemporaryFolder folder_;
};

TEST_F(TomoPlacesProgram, TwoPartsAndAnAxisAtTheImagesEdge) {
  std::string edge = test::bench_printer_toml();
  edge.replace(edge.find("[rotation]"), 0, "axis_up_px = -20\n");
  write("edge.toml", edge);
  // The image begins at the optical axis: half of a part that is middled on it lies beside.
  const test::RunResult below = solve({"a.off"}, "edge.toml");
  EXPECT_EQ(below.exit_code, 2);
  EXPECT_THAT(below.err, HasSubstr("expected the 1 mm of the part in it, -0.500 to 0.500 mm"));
  const std::vector<std::string> both{"a.off",   "--at-mm", "1.5,0,0",       "b.off",
                                      "--at-mm", "-1,-1,3", "--base-on-axis"};
  const test::RunResult solved = solve(both, "edge.toml");
  ASSERT_EQ(solved.exit_code, 0) << solved.out << solved.err;
  const auto figures = nlohmann::json::parse(solved.out);
  EXPECT_EQ(figures["ver"], 0.0);
  const TomoJob job = read_job(folder_ / "o.frames");
  EXPECT_EQ(job.part.nz, 14);
  EXPECT_NEAR(job.sampling.middle_z_mm, 1.75, 1e-12);
  // b is 3 of 4 voxels wide in part: its surface is judged as what it is.
  const test::RunResult verified = call({"verify", "o.frames", "--json", "-"});
  EXPECT_EQ(verified.exit_code, 0) << verified.err;
  const auto surface = nlohmann::json::parse(verified.out)["surface"];
  EXPECT_GT(surface["voxels"], 0);
  EXPECT_LT(std::abs(surface["mean_um"].get<double>()), 250);
  // Rows above the image's lowest, none below it, show light; of the part at the bottom 4 rows.
  const test::RunResult cut = call({"section", "o.frames", "--z-mm", "3.1", "-o", "cut.png"});
  EXPECT_EQ(cut.exit_code, 0) << cut.err;
  const test::RunResult beside = call({"section", "o.frames", "--z-mm", "-0.2", "-o", "cut.png"});
  EXPECT_EQ(beside.exit_code, 2);
  EXPECT_THAT(beside.err, HasSubstr("expected 0.000 to 3.500 mm"));
}

TEST_F(TomoPlacesProgram, PlacesThatCanNotBeAreRefusedByName) {
  const auto refused = [&](const std::vector<std::string>& words, const std::string& text) {
    const test::RunResult result = solve(words);
    EXPECT_EQ(result.exit_code, 2);
    EXPECT_THAT(result.err, HasSubstr(text));
  };
  refused({"a.off", "b.off"}, "a.off and b.off overlap");
  refused({"a.off", "--at-mm", "1,0,0", "b.off", "--at-mm", "1.5,0,0"}, "a.off and b.off overlap");
  refused({"a.off", "b.off", "--at-mm", "1,0,0"}, "--at-mm says 3 numbers for 2 parts");
  refused({"a.off", "--at-mm", "3.9,0,0"}, "a.off: the part reaches");
  refused({"a.off", "--at-mm", "0,0,5"}, "its image is 10 mm high");
  refused({"a.off", "--at-mm", "1,0,0", "b.off", "--at-mm", "-1,0,0", "--insert", "a.off"},
          "expected one part");
}

}  // namespace
}  // namespace slicecorr::tomo
