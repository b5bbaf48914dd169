// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Surfaces of prints: planes whose place is known.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "slicecorr/tomo/surface.hpp"

namespace slicecorr::tomo {
namespace {

constexpr int kSide = 15;
constexpr double kVoxelMm = 0.2;

/// Share of a voxel below a plane at this distance from its middle, along a normal, counted at 20³ points.
double share_below(double distance, const std::array<double, 3>& n) {
  constexpr int fine = 20;
  if (std::abs(distance) > 1) return distance > 0 ? 1 : 0;
  int below = 0;
  for (int i = 0; i < fine * fine * fine; ++i) {
    const auto at = [&](int k) { return (k + 0.5) / fine - 0.5; };
    below +=
        n[0] * at(i % fine) + n[1] * at(i / fine % fine) + n[2] * at(i / fine / fine) < distance;
  }
  return below / static_cast<double>(fine * fine * fine);
}

SurfaceFigures of_plane(const std::array<double, 3>& n, double out) {
  Box<std::uint8_t> part{kSide, kSide, kSide, {}};
  Box<float> dose{kSide, kSide, kSide, {}};
  for (int z = 0; z < kSide; ++z) {
    for (int y = 0; y < kSide; ++y) {
      for (int x = 0; x < kSide; ++x) {
        // In voxels; the part is below the plane.
        const double place = n[0] * (x - 7.0) + n[1] * (y - 7.0) + n[2] * (z - 7.0);
        part.values.push_back(
            static_cast<std::uint8_t>(std::lround(255 * share_below(0.3 - place, n))));
        // 20 gels: so far out of the plane.
        dose.values.push_back(static_cast<float>(20 + 3 * (0.3 + out - place)));
      }
    }
  }
  return surface_of(dose, part, {}, kVoxelMm, 20);
}

/// Upright planes: shares are those of one axis, of which six points tell a sixth. Where nothing is off, the
/// surface is where it should be, to half of that; where the dose reaches a quarter of a voxel farther, it is
/// that, as long as it stays in the voxel.
TEST(TomoSurface, UprightPlanesStandWhereTheyStand) {
  const SurfaceFigures none = of_plane({1, 0, 0}, 0);
  EXPECT_GT(none.voxels, 100U);
  EXPECT_NEAR(none.mean_um, 0, 200.0 / 12 + 1);
  const SurfaceFigures back = of_plane({1, 0, 0}, -0.25);
  EXPECT_NEAR(back.mean_um, -50, 200.0 / 12 + 1);
  EXPECT_NEAR(back.rms_um, 50, 200.0 / 12 + 1);
}

/// Tilted ones: means are exact to what points tell.
TEST(TomoSurface, TiltedPlanesDo) {
  const double s = 1 / std::sqrt(3.0);
  const SurfaceFigures none = of_plane({s, s, s}, 0);
  EXPECT_NEAR(none.mean_um, 0, 2);
  EXPECT_LT(none.rms_um, 6);
  EXPECT_GT(of_plane({s, s, s}, 0.1).mean_um, none.mean_um + 5);
  EXPECT_LT(of_plane({s, s, s}, -0.1).mean_um, none.mean_um - 5);
}

TEST(TomoSurface, VoxelsOfOneKindAndInsertsAreNone) {
  Box<std::uint8_t> part{3, 9, 9, std::vector<std::uint8_t>(243, 255)};
  const Box<float> dose{3, 9, 9, std::vector<float>(243, 30)};
  EXPECT_EQ(surface_of(dose, part, {}, 0.1, 20).voxels, 0U);
  part.values[part.at(1, 4, 4)] = 100;
  EXPECT_EQ(surface_of(dose, part, {}, 0.1, 20).voxels, 1U);
  EXPECT_NEAR(surface_of(dose, part, {}, 0.1, 20).mean_um, 100 * (1 - 100 / 255.0), 1e-9);
  EXPECT_EQ(surface_of(dose, part, part, 0.1, 20).voxels, 0U);
}

}  // namespace
}  // namespace slicecorr::tomo
