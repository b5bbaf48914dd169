// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Necks of one voxel where light spreads: what a design joins by them hangs together in the print.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <random>

#include "bodies_grid.hpp"
#include "correct/coupled_necks.hpp"
#include "memory_slices.hpp"
#include "models.hpp"
#include "rounds.hpp"
#include "slicecorr/bodies.hpp"
#include "slicecorr/pipeline.hpp"

namespace slicecorr::test {
namespace {

constexpr int kSide = 16, kTall = 26;

/// Plates that hang together by columns and bars one voxel wide.
MemorySlices random_plates(std::mt19937& random) {
  MemorySlices slices(grid_of(kSide, kSide, kTall));
  const auto number = [&](int least, int most) {
    return std::uniform_int_distribution<int>(least, most)(random);
  };
  int x0 = 2, y0 = 2, x1 = 14, y1 = 14, n = 4;
  fill(slices, {x0, y0, 0}, {x1, y1, n});
  while (n < kTall - 8) {
    const int x = number(x0, x1 - 1), y = number(y0, y1 - 1), tall = number(1, 3);
    fill(slices, {x, y, n}, {x + 1, y + 1, n + tall});
    x0 = std::max(0, x - number(0, 7));
    y0 = std::max(0, y - number(0, 7));
    x1 = std::min(kSide, x + 1 + number(0, 7));
    y1 = std::min(kSide, y + 1 + number(0, 7));
    const int thick = number(1, 6);
    fill(slices, {x0, y0, n + tall}, {x1, y1, n + tall + thick});
    n += tall + thick;
  }
  return slices;
}

slicecorr::Setup spreading(double sigma_um, ExposureMode mode) {
  slicecorr::Setup s{linear_printer(1, 100), resin(576, 2000), process(1000)};
  s.printer.pixel_x_um = s.printer.pixel_y_um = kPixelUm;
  if (mode == ExposureMode::layerwise) {
    s.printer = linear_printer(0, 100);
    s.printer.pixel_x_um = s.printer.pixel_y_um = kPixelUm;
    s.resin = resin(20, 400);
    s.process.mode = mode;
    s.process.exposure_s = 0.6;
  }
  s.printer.spread = {{{sigma_um, 1}}, std::nullopt};
  return s;
}

/// Loose bodies that have more than gaps that cure.
std::uint64_t features_loose(const Bodies& printed, const MemorySlices& design) {
  std::uint64_t loose = 0;
  for (const Island& i : printed.islands) {
    const bool a_gap = i.voxels == 1 && design.at(i.first, i.x, i.y) == 0;
    loose += i.until < 0 && !a_gap;
  }
  return loose;
}

TEST(BodiesWhereLightSpreads, NecksOfOneVoxelHold) {
  std::mt19937 random(64);
  const std::array<double, 3> sigmas_um = {15, 25, 40};
  MemorySlices pillar(grid_of(kSide, kSide, kTall));
  fill(pillar, {8, 8, 0}, {9, 9, kTall});
  for (const ExposureMode mode : {ExposureMode::continuous, ExposureMode::layerwise}) {
    // Most of a neck alone prints, its ends aside.
    for (const double sigma_um : sigmas_um) {
      const slicecorr::Setup setup = spreading(sigma_um, mode);
      const CorrectedSlices corrected(pillar, setup);
      EXPECT_LT(verify_stack(corrected, pillar, setup).undercure_voxels, kTall / 3) << sigma_um;
    }
  }
  for (int round = 0; round < rounds(12); ++round) {
    const MemorySlices design = random_plates(random);
    ASSERT_EQ(find_bodies(design).loose_bodies, 0U);
    for (const double sigma_um : sigmas_um) {
      for (const ExposureMode mode : {ExposureMode::continuous, ExposureMode::layerwise}) {
        const slicecorr::Setup setup = spreading(sigma_um, mode);
        const CorrectedSlices corrected(design, setup);
        const Prediction p = verify_stack(corrected, design, setup);
        ASSERT_TRUE(p.bodies);
        EXPECT_EQ(features_loose(p.bodies->printed, design), 0U)
            << round << " " << sigma_um << " um, mode " << static_cast<int>(mode);
      }
    }
  }
}

/// Whether faces hang together, by a search of its own: labels of all voxels spread until nothing changes.
bool hangs_without_middle(const detail::VoxelsAround& solid) {
  std::array<int, 27> label{};
  for (int k = 0; k < 27; ++k) label[static_cast<std::size_t>(k)] = k;
  const auto at = [&](int x, int y, int z) { return static_cast<std::size_t>(x + 3 * y + 9 * z); };
  for (int times = 0; times < 27; ++times) {
    for (int z = 0; z < 3; ++z) {
      for (int y = 0; y < 3; ++y) {
        for (int x = 0; x < 3; ++x) {
          for (const auto& [dx, dy, dz] : {std::array{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}) {
            if (x + dx > 2 || y + dy > 2 || z + dz > 2) continue;
            const std::size_t a = at(x, y, z), b = at(x + dx, y + dy, z + dz);
            if (a == 13 || b == 13 || !solid[a] || !solid[b]) continue;
            label[a] = label[b] = std::min(label[a], label[b]);
          }
        }
      }
    }
  }
  int first = -1;
  for (const std::size_t face : {4, 10, 12, 14, 16, 22}) {
    if (!solid[face]) continue;
    if (first >= 0 && label[face] != first) return false;
    first = label[face];
  }
  return true;
}

TEST(BodiesWhereLightSpreads, AVoxelJoinsAloneWhereNothingElseAroundItDoes) {
  std::mt19937 random(65);
  int alone = 0;
  for (int k = 0; k < 2000; ++k) {
    const detail::VoxelsAround solid(random() & random());
    EXPECT_EQ(detail::joins_alone(solid), !hangs_without_middle(solid)) << solid;
    alone += detail::joins_alone(solid) ? 1 : 0;
  }
  EXPECT_GT(alone, 200);
  EXPECT_LT(alone, 1800);
}

}  // namespace
}  // namespace slicecorr::test
