// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Light that scatters on its way through a resin, against light that diffuses over a grid much finer than
// the pixels, step by step of its way.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

#include "cure/distance_blurs.hpp"

namespace slicecorr {
namespace {

using detail::DistanceBlur;
using detail::ScatterWay;
using Field = std::vector<double>;

/// Pixels of the plane, and cells along a pixel: an odd number, so that its middle is a cell's.
constexpr int kPixels = 15, kCells = 7;
constexpr int kFine = kPixels * kCells;

/// A wall with a corner, and a line of one pixel beside it.
bool lit(int x, int y) { return (x < 6 && y < 9) || x == 9; }

/// Light on the fine grid, which goes on in steps of its way.
class FineLight {
 public:
  FineLight(double pixel_um, double variance_um2) : cell_um_(pixel_um / kCells) {
    for (int y = 0; y < kFine; ++y) {
      for (int x = 0; x < kFine; ++x) light_.push_back(lit(x / kCells, y / kCells) ? 1 : 0);
    }
    diffuse(variance_um2);
  }
  /// Its variance grows by so much: four neighbours give and take.
  void diffuse(double variance_um2) {
    const double whole = variance_um2 / (2 * cell_um_ * cell_um_);
    const int steps = static_cast<int>(std::ceil(whole / 0.1));
    for (int s = 0; s < steps; ++s) step(whole / steps);
  }
  double middle(int x, int y) const {
    return light_[static_cast<std::size_t>((y * kCells + kCells / 2) * kFine + x * kCells +
                                           kCells / 2)];
  }

 private:
  void step(double share) {
    Field next(light_.size());
    const auto at = [&](int x, int y) {
      // Beyond the grid it is as at its edge.
      x = std::clamp(x, 0, kFine - 1);
      y = std::clamp(y, 0, kFine - 1);
      return light_[static_cast<std::size_t>(y * kFine + x)];
    };
    for (int y = 0; y < kFine; ++y) {
      for (int x = 0; x < kFine; ++x) {
        const double around = at(x - 1, y) + at(x + 1, y) + at(x, y - 1) + at(x, y + 1);
        next[static_cast<std::size_t>(y * kFine + x)] = at(x, y) + share * (around - 4 * at(x, y));
      }
    }
    light_ = std::move(next);
  }
  double cell_um_;
  Field light_;
};

/// What slices 0 to `last` give the node of the first, when all show the same, in the middles of pixels.
Field by_fine_steps(const ScatterWay& way, double sigma_um, int last) {
  FineLight light(way.pixel_x_um, sigma_um * sigma_um);
  Field dose(kPixels * kPixels, 0.0);
  const auto add = [&](double share) {
    for (int y = 0; y < kPixels; ++y) {
      for (int x = 0; x < kPixels; ++x) {
        dose[static_cast<std::size_t>(y * kPixels + x)] += share * light.middle(x, y);
      }
    }
  };
  constexpr int kSteps = 4;
  const double step_um = way.slice_um / kSteps;
  const double a = std::exp(-way.slice_um / way.height_e_um);
  double d_um = 0;
  for (int n = 0; n <= last; ++n) {
    for (int s = 0; s < kSteps; ++s, d_um += step_um) {
      light.diffuse(way.um2_per_um * step_um / 2);
      if (!way.layerwise) {
        add(std::exp(-d_um / way.height_e_um) - std::exp(-(d_um + step_um) / way.height_e_um));
      }
      light.diffuse(way.um2_per_um * step_um / 2);
    }
    if (way.layerwise) add((1 - a) * std::pow(a, n));
  }
  return dose;
}

/// The same of slices by their distances.
Field by_distances(const LightSpread& spread, const ScatterWay& way, int last) {
  // Light goes on as at the edges of the image.
  constexpr int far = 30;
  const PixelBox box{-far, -far, kPixels + far, kPixels + far}, image{0, 0, kPixels, kPixels};
  Field light;
  for (int y = box.y0; y < box.y1; ++y) {
    for (int x = box.x0; x < box.x1; ++x) {
      light.push_back(lit(std::clamp(x, 0, kPixels - 1), std::clamp(y, 0, kPixels - 1)) ? 1 : 0);
    }
  }
  Field dose(kPixels * kPixels, 0.0), seen(dose.size());
  for (const DistanceBlur& d : detail::distance_blurs(spread, way, 0)) {
    if (d.from > last) continue;
    d.blur.apply(light.data(), box, seen.data(), image);
    const double share = std::exp(-d.from * way.slice_um / way.height_e_um) -
                         std::exp(-std::min(d.to, last + 1) * way.slice_um / way.height_e_um);
    for (std::size_t i = 0; i < dose.size(); ++i) dose[i] += share * seen[i];
  }
  return dose;
}

/// The greatest difference in pixels away from the image's edges, beyond which it was made up.
double greatest_difference(const Field& a, const Field& b) {
  double most = 0;
  for (int y = 3; y < kPixels - 3; ++y) {
    for (int x = 3; x < kPixels - 3; ++x) {
      const auto at = static_cast<std::size_t>(y * kPixels + x);
      most = std::max(most, std::abs(a[at] - b[at]));
    }
  }
  return most;
}

struct Case {
  ScatterWay way;
  double sigma_um;
};

std::vector<Case> cases() {
  return {{{1, 650, 50, false, 50, 50}, 0},
          {{1, 130, 50, false, 50, 50}, 0},
          {{1, 300, 20, false, 20, 20}, 15},
          {{1, 100, 50, true, 50, 50}, 0}};
}

// Cells of a 7th of a pixel: their edges lie in the middles between cells, and light that has diffused less
// than a cell is a step as wide as one; of half of a step, a 14th of a pixel, times the slope of the light there,
// at most 1 / (sqrt(2 pi) sigma), 7e-3 is left where sigma is a pixel's fifth or more, and nothing below.
constexpr double kFineOff = 7e-3;
// Distances that share a kernel are off by 2e-3 beside a straight edge at the most (distance_blurs), by twice that
// where a corner and a line get it from two sides.
constexpr double kOff = kFineOff + 2 * 2e-3;

TEST(ScatterGrid, BesideWallsDosesAreThoseOfTheDepths) {
  for (const Case& c : cases()) {
    const LightSpread spread{{{c.sigma_um, 1}}, std::nullopt};
    const int slices = static_cast<int>(9 * c.way.height_e_um / c.way.slice_um);
    const Field fine = by_fine_steps(c.way, c.sigma_um, slices);
    EXPECT_LE(greatest_difference(fine, by_distances(spread, c.way, slices)), kOff)
        << c.way.height_e_um;
  }
}

// Below the end of a wall: slices from some distance on are dark.
TEST(ScatterGrid, BelowTheEndOfAWallDosesAreThoseOfTheDepths) {
  for (const Case& c : cases()) {
    const LightSpread spread{{{c.sigma_um, 1}}, std::nullopt};
    for (const int last : {0, 3, 12}) {
      const Field fine = by_fine_steps(c.way, c.sigma_um, last);
      EXPECT_LE(greatest_difference(fine, by_distances(spread, c.way, last)), kOff)
          << c.way.height_e_um << " " << last;
    }
  }
}

// So exactly they tell apart what scatters less.
TEST(ScatterGrid, LessScatterIsAnotherDose) {
  Case c = cases().front();
  const Field fine = by_fine_steps(c.way, 0, 117);
  c.way.um2_per_um = 0.7;
  EXPECT_GT(greatest_difference(fine, by_distances({}, c.way, 117)), kOff);
}

}  // namespace
}  // namespace slicecorr
