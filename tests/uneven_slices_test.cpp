// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Meshes cut into layers of different heights.

#include "slicecorr/uneven_slices.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "meshes.hpp"
#include "slicecorr/error.hpp"

namespace slicecorr::test {
namespace {

using testing::HasSubstr;

std::string refused(const std::vector<double>& um) {
  try {
    thin_slice_um(LayerHeights(um));
  } catch (const InputError& e) {
    return e.what();
  }
  return "";
}

TEST(UnevenSlices, AreThoseOfEvenOnesAtTheSameHeight) {
  const Printer p = printer(80, 80, 50, 50);
  const TriangleMesh mesh = sphere(1.5, 4);
  std::vector<double> um(20, 50.0);
  um.push_back(100);
  const LayerHeights heights(um);
  EXPECT_EQ(thin_slice_um(heights), 25);
  SliceOptions thin = layer_of(25);
  thin.edge_heights = false;
  thin.raised_um = 12.5;
  const MeshSlices cuts(mesh, p, thin);
  const UnevenSlices slices(cuts, heights);
  // 1 mm in layers of 50 um, 2 mm in those of 100.
  ASSERT_EQ(slices.grid().layers, 40);
  EXPECT_EQ(slices.grid().layer_um, 100);
  const MeshSlices low(mesh, p, layer_of(50)), high(mesh, p, layer_of(100));
  const auto uneven = read(slices), lower = read(low), upper = read(high);
  std::size_t lit = 0;
  for (std::size_t n = 0; n < uneven.size(); ++n) {
    const Bytes& same = n < 20 ? lower[n] : upper[n - 10];
    for (std::size_t i = 0; i < same.size(); ++i) {
      // Heights go through other sums: a level where one is just on the edge of the next.
      ASSERT_NEAR(uneven[n][i], same[i], 1) << n << " " << i;
      lit += same[i] == 255;
    }
  }
  EXPECT_GT(lit, 1000u);
  // Any range of layers by itself.
  std::vector<int> asked;
  slices.read_slices(slices.bounds(), 18, 22,
                     [&](int n, const std::uint8_t*) { asked.push_back(n); });
  EXPECT_EQ(asked, (std::vector<int>{18, 19, 20, 21}));
}

TEST(UnevenSlices, HeightsNeedACommonMeasure) {
  EXPECT_EQ(refused({20, 50, 100}), "");
  EXPECT_THAT(refused({50, 33.3}), HasSubstr("greatest common measure"));
  EXPECT_THAT(refused({50, 0}), HasSubstr("layer 1 is 0 um high"));
  EXPECT_THAT(refused({2000}), HasSubstr("expected 1 to 1000 um"));
}

/// Sides of a slope of which a step of `n` units is just a unit away.
TEST(AdaptiveHeights, AreAsHighAsSlopesAllow) {
  // A cone of 48 corners: its sides lie at the middle of its edges.
  for (const double height_mm : {2.0, 4.0, 6.0}) {
    const TriangleMesh mesh = cone(1, height_mm, 48);
    const double inner = std::cos(std::numbers::pi / 48);
    const double n_z = inner / std::hypot(inner, height_mm);
    const int units = std::min(5, static_cast<int>(std::floor(1 / n_z)));
    const LayerHeights heights = adaptive_heights(mesh, 20, 100);
    double sum = 0;
    for (std::size_t n = 0; n + 1 < heights.um().size(); ++n) {
      EXPECT_EQ(heights.um()[n], 20.0 * units) << height_mm << " " << n;
      sum += heights.um()[n];
    }
    EXPECT_NEAR(sum + heights.um().back(), height_mm * 1000, 100) << height_mm;
  }
  // Walls and level faces: as high as may be, and layers end at the face.
  const LayerHeights steps =
      adaptive_heights(box({0, 0, 0}, {2, 2, 1.06}) + box({0, 0, 1.06}, {1, 1, 2.06}), 20, 100);
  double at = 0;
  bool ends = false;
  for (const double um : steps.um()) {
    at += um;
    ends = ends || std::abs(at - 1060) < 1e-9;
  }
  EXPECT_TRUE(ends);
  EXPECT_EQ(steps.um().front(), 100);
  for (const auto& [least, most] :
       {std::pair{20.0, 50.0}, {1.0, 10.0}, {50.0, 20.0}, {100.0, 2000.0}}) {
    EXPECT_THROW(adaptive_heights(cone(1, 2, 8), least, most), InputError) << least;
  }
}

}  // namespace
}  // namespace slicecorr::test
