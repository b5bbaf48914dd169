// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Few levels in an image whose light spreads: surplus goes to neighbours, nothing that is missing.
#include "correct/plane_levels.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numeric>
#include <random>

namespace slicecorr::detail {
namespace {

constexpr double kPixelUm = 50;

LevelTable even_levels(int count, double least = 0.0625, double most = 6.25) {
  std::vector<double> phi;
  for (int l = 0; l < count; ++l) phi.push_back(least + (most - least) * l / (count - 1));
  return LevelTable(phi);
}

LightBlur blur_of(double sigma_px) {
  LightSpread spread;
  spread.gaussians = {{sigma_px * kPixelUm, 1}};
  return LightBlur(spread, kPixelUm, kPixelUm);
}

struct Image {
  int width, height;
  std::vector<double> wanted, needed;
  std::vector<std::uint8_t> feature;
  Image(int w, int h, double light, bool lit)
      : width(w),
        height(h),
        wanted(static_cast<std::size_t>(w) * static_cast<std::size_t>(h), light),
        needed(wanted.size(), 0.0),
        feature(wanted.size(), lit ? 1 : 0) {}
  std::size_t at(int x, int y) const {
    return static_cast<std::size_t>(y) * static_cast<std::size_t>(width) +
           static_cast<std::size_t>(x);
  }
  PlaneOfLight plane() const {
    return {width, height, wanted.data(), needed.data(), feature.data()};
  }
  PixelBox box() const { return {0, 0, width, height}; }
};

/// What arrives of light that is shown: by our own sum over the weights of a spot.
std::vector<double> arrives(const Image& image, const std::vector<double>& light, double sigma_px) {
  const auto taps = gaussian_taps(sigma_px * kPixelUm, kPixelUm);
  const int reach = static_cast<int>(taps.size()) - 1;
  std::vector<double> out(light.size(), 0.0);
  for (int y = 0; y < image.height; ++y) {
    for (int x = 0; x < image.width; ++x) {
      for (int dy = -reach; dy <= reach; ++dy) {
        for (int dx = -reach; dx <= reach; ++dx) {
          const int px = x + dx, py = y + dy;
          if (px < 0 || py < 0 || px >= image.width || py >= image.height) continue;
          out[image.at(x, y)] += light[image.at(px, py)] *
                                 taps[static_cast<std::size_t>(std::abs(dx))] *
                                 taps[static_cast<std::size_t>(std::abs(dy))];
        }
      }
    }
  }
  return out;
}

std::vector<double> shown(const LevelTable& table, const PlaneOfLevels& levels) {
  std::vector<double> light;
  for (const std::uint8_t l : levels.levels) light.push_back(table.phi(l));
  return light;
}

double mean(const std::vector<double>& values) {
  return std::accumulate(values.begin(), values.end(), 0.0) / static_cast<double>(values.size());
}

TEST(PlaneLevels, TheMeanOfAnEvenFeatureIsWhatIsWanted) {
  for (const int count : {2, 3, 4, 8, 16}) {
    const LevelTable table = even_levels(count);
    for (const double sigma : {0.5, 0.8, 1.5}) {
      const Image image(40, 40, 2.3, true);
      const PlaneOfLevels got = levels_of_plane(table, image.plane(), blur_of(sigma));
      EXPECT_TRUE(got.handed_on);
      // What the last pixel can't hand on stays: less than a step of one pixel of 1600, or of a few.
      const double step = table.phi(1) - table.phi(0);
      EXPECT_NEAR(mean(shown(table, got)), 2.3, step / 100) << count << " " << sigma;
      EXPECT_GE(mean(shown(table, got)), 2.3 - 1e-12);
    }
  }
}

TEST(PlaneLevels, LightIsEvenerThanWithoutHandingOn) {
  const LevelTable table = even_levels(4);
  const Image image(40, 40, 2.3, true);
  const PlaneOfLevels got = levels_of_plane(table, image.plane(), blur_of(1.5));
  const auto light = arrives(image, shown(table, got), 1.5);
  // Rounded up every pixel would have 4.1875. Away from the rim:
  for (int y = 8; y < 32; ++y) {
    for (int x = 8; x < 32; ++x) EXPECT_NEAR(light[image.at(x, y)], 2.3, 0.35) << x << " " << y;
  }
}

TEST(PlaneLevels, NarrowSpreadsHandNothingOn) {
  const LevelTable table = even_levels(4);
  Image image(12, 12, 2.3, true);
  image.wanted[image.at(3, 4)] = 1.0;
  for (const double sigma : {0.0, 0.3, 0.45}) {
    const PlaneOfLevels got = levels_of_plane(table, image.plane(), blur_of(sigma));
    EXPECT_FALSE(got.handed_on) << sigma;
    for (std::size_t k = 0; k < image.wanted.size(); ++k) {
      EXPECT_EQ(got.levels[k], table.at_least(image.wanted[k])) << sigma;
    }
  }
  EXPECT_TRUE(levels_of_plane(table, image.plane(), blur_of(0.5)).handed_on);
}

TEST(PlaneLevels, NoPixelOfAFeatureHasLessThanItNeeds) {
  std::mt19937 random(17);
  for (int k = 0; k < 60; ++k) {
    const double sigma = 0.2 + 0.1 * static_cast<double>(random() % 16);
    const LevelTable table = even_levels(2 + static_cast<int>(random() % 15));
    Image image(24, 20, 0.0625, false);
    for (int r = 0; r < 5; ++r) {
      const int x0 = static_cast<int>(random() % 20), y0 = static_cast<int>(random() % 16);
      const double light = 1.2 + 0.3 * static_cast<double>(random() % 10);
      for (int y = y0; y < std::min(20, y0 + 6); ++y) {
        for (int x = x0; x < std::min(24, x0 + 6); ++x) {
          image.feature[image.at(x, y)] = 1;
          image.wanted[image.at(x, y)] = light;
        }
      }
    }
    // What is wanted is just what is needed.
    image.needed = arrives(image, image.wanted, sigma);
    const PlaneOfLevels got = levels_of_plane(table, image.plane(), blur_of(sigma));
    EXPECT_EQ(got.short_pixels, 0U) << k;
    EXPECT_EQ(got.most_short, 0) << k;
    const auto light = arrives(image, shown(table, got), sigma);
    for (std::size_t i = 0; i < light.size(); ++i) {
      if (image.feature[i]) {
        EXPECT_GE(light[i], image.needed[i] - 1e-9) << k;
      } else {
        EXPECT_LE(table.phi(got.levels[i]), image.wanted[i]) << k;
      }
    }
  }
}

TEST(PlaneLevels, WhatIsMissingIsToldAndSoMuch) {
  const LevelTable table = even_levels(8);
  Image image(9, 9, 0.0625, false);
  image.feature[image.at(4, 4)] = 1;
  image.wanted[image.at(4, 4)] = 6.25;
  image.needed[image.at(4, 4)] = 3;
  const PlaneOfLevels got = levels_of_plane(table, image.plane(), blur_of(1.5));
  EXPECT_EQ(got.short_pixels, 1U);
  EXPECT_NEAR(got.most_short, 3 - arrives(image, shown(table, got), 1.5)[image.at(4, 4)], 1e-12);
}

TEST(PlaneLevels, SurplusStaysInItsFeature) {
  const LevelTable table = even_levels(4);
  Image alone(30, 12, 0.0625, false), beside(30, 12, 0.0625, false);
  for (int y = 0; y < 12; ++y) {
    for (int x = 0; x < 30; ++x) {
      const bool left = x < 14, right = x >= 15;
      if (right || left) beside.feature[beside.at(x, y)] = 1;
      if (right) alone.feature[alone.at(x, y)] = 1;
      if (right) alone.wanted[alone.at(x, y)] = beside.wanted[beside.at(x, y)] = 2.9;
      if (left) beside.wanted[beside.at(x, y)] = 4.4;
    }
  }
  const PlaneOfLevels a = levels_of_plane(table, alone.plane(), blur_of(1.5));
  const PlaneOfLevels b = levels_of_plane(table, beside.plane(), blur_of(1.5));
  for (int y = 0; y < 12; ++y) {
    for (int x = 15; x < 30; ++x) {
      EXPECT_EQ(a.levels[alone.at(x, y)], b.levels[beside.at(x, y)]);
    }
  }
}

}  // namespace
}  // namespace slicecorr::detail
