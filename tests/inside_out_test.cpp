// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Bodies that are inside out beside others: what prints is the union of all solids, counted voxel by
/// voxel.
#include <gtest/gtest.h>

#include <algorithm>
#include <random>
#include <vector>

#include "meshes.hpp"
#include "rounds.hpp"
#include "slicecorr/mesh.hpp"
#include "slicecorr/slice.hpp"

namespace slicecorr::test {
namespace {

/// What is lit of slices in pixels of 1 mm and layers of 1 mm.
std::size_t printed_mm3(const TriangleMesh& mesh, MeshReport* report = nullptr) {
  EdgeDefects edges;
  const MeshReport r = inspect(mesh, {}, &edges);
  if (report) *report = r;
  SliceOptions options = layer_of(1000);  // whole millimetres stay whole ones
  options.center_mm = {{(r.lower[0] + r.upper[0]) / 2 + 20, (r.lower[1] + r.upper[1]) / 2 + 20}};
  const MeshSlices slices(mesh, printer(64, 64, 1000, 1000), options, {}, &edges);
  std::size_t lit = 0;
  const Grid& g = slices.grid();
  slices.read_band({0, 0, g.width_px, g.height_px}, [&](int, const std::uint8_t* rows) {
    if (rows) lit += static_cast<std::size_t>(std::count(rows, rows + 64 * 64, 255));
  });
  return lit;
}

TEST(InsideOut, TwoThatOverlapPrintTheirUnion) {
  const TriangleMesh a = box({0, 0, 0}, {6, 6, 6}), b = box({4, 4, 4}, {10, 10, 10});
  MeshReport report;
  EXPECT_EQ(printed_mm3(a + inverted(b), &report), 2U * 216 - 8);
  EXPECT_EQ(report.defects.inside_out_bodies, 1U);
  EXPECT_EQ(describe(report.defects), "1 body inside out beside others, which is turned");
  EXPECT_EQ(printed_mm3(inverted(a) + b, &report), 2U * 216 - 8);
  EXPECT_EQ(report.defects.inside_out_bodies, 1U);
  EXPECT_EQ(printed_mm3(a + b, &report), 2U * 216 - 8);
  EXPECT_EQ(report.defects.inside_out_bodies, 0U);
}

TEST(InsideOut, HollowsAreNone) {
  const TriangleMesh outer = box({0, 0, 0}, {8, 8, 8}),
                     hollow = inverted(box({2, 2, 2}, {5, 5, 5}));
  MeshReport report;
  EXPECT_EQ(printed_mm3(outer + hollow, &report), 512U - 27);
  EXPECT_EQ(report.defects.inside_out_bodies, 0U);
  // One that is open at the top.
  EXPECT_EQ(printed_mm3(outer + inverted(box({2, 2, 2}, {5, 5, 8})), &report), 512U - 54);
  EXPECT_EQ(report.defects.inside_out_bodies, 0U);
  // The whole part inside out prints the same, as it is.
  EXPECT_EQ(printed_mm3(inverted(outer + hollow), &report), 512U - 27);
  EXPECT_EQ(report.defects.inside_out_bodies, 0U);
  EXPECT_EQ(describe(report.defects), "all inside out, cut as if turned");
  EXPECT_EQ(printed_mm3(inverted(outer), &report), 512U);
  EXPECT_TRUE(report.defects.all_inside_out);
  EXPECT_EQ(printed_mm3(outer, &report), 512U);
  EXPECT_EQ(describe(report.defects), "");
  // Beside another one it is turned with its hollow, and with what is in that.
  const TriangleMesh core = box({3, 3, 3}, {4, 4, 4}), other = box({7, 7, 7}, {12, 12, 12});
  EXPECT_EQ(printed_mm3(inverted(outer + hollow + core) + other, &report), 512U - 27 + 1 + 125 - 1);
  EXPECT_EQ(report.defects.inside_out_bodies, 1U);
}

TEST(InsideOut, NothingIsTurnedWhereAHoleIsOpen) {
  TriangleMesh open = inverted(box({4, 4, 4}, {10, 10, 10}));
  open.triangles.pop_back();
  const MeshReport report = inspect(box({0, 0, 0}, {6, 6, 6}) + open);
  EXPECT_EQ(report.defects.inside_out_bodies, 0U);
  EXPECT_GT(report.defects.open_edges, 0U);
}

TEST(InsideOut, RandomSolidsPrintTheirUnion) {
  std::mt19937 random(64);
  const auto number = [&](int least, int most) {
    return std::uniform_int_distribution<int>(least, most)(random);
  };
  int turned = 0;
  for (int round = 0; round < rounds(200); ++round) {
    SCOPED_TRACE(round);
    TriangleMesh mesh;
    std::vector<bool> solid(20 * 20 * 20, false);
    const auto put = [&](const Point3& low, const Point3& high, const Point3* hole) {
      for (int z = int(low[2]); z < int(high[2]); ++z) {
        for (int y = int(low[1]); y < int(high[1]); ++y) {
          for (int x = int(low[0]); x < int(high[0]); ++x) {
            const bool hollow = hole && x == (*hole)[0] && y == (*hole)[1] && z == (*hole)[2];
            if (!hollow) solid[static_cast<std::size_t>((z * 20 + y) * 20 + x)] = true;
          }
        }
      }
    };
    // Each sticks out of all before it at its far end, and of all after it below; the first is as it
    // should be.
    const int count = number(2, 4);
    double far = 0;
    for (int k = 0; k < count; ++k) {
      const Point3 low{double(number(0, k == 0 ? 2 : int(far) - 1)), double(number(0, 6)),
                       double(k)};
      const double past = std::max(far, low[0] + 3) + number(1, 3);
      const Point3 high{past, low[1] + number(3, 12), low[2] + number(3, 12)};
      far = past;
      const Point3 hole{low[0] + 1, low[1] + 1, low[2] + 1};
      const bool hollow = number(0, 2) == 0;
      TriangleMesh part = box(low, high);
      if (hollow) part = part + inverted(box(hole, {hole[0] + 1, hole[1] + 1, hole[2] + 1}));
      const bool inside_out = k > 0 && number(0, 1) == 0;
      turned += inside_out;
      mesh = mesh + (inside_out ? inverted(part) : part);
      put(low, high, hollow ? &hole : nullptr);
    }
    EXPECT_EQ(printed_mm3(mesh),
              static_cast<std::size_t>(std::count(solid.begin(), solid.end(), true)));
    if (HasFailure()) return;
  }
  EXPECT_GT(turned, 100);
}

}  // namespace
}  // namespace slicecorr::test
