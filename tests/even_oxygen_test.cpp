// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Light that evens out oxygen in the plane of a slice: what must hold, and what the full equations say of it.
#include "chemistry/even_oxygen.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <cmath>

#include "chemistries.hpp"
#include "slicecorr/chemistry.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/process.hpp"

namespace slicecorr {
namespace {

using detail::EvenOxygen;
using detail::OxygenImage;
using detail::OxygenLight;
using test::hydrogel;

/// 0 to 1020 mW/cm² in even steps of 4: level 25 is 100.
OxygenLight light_of(double cell_um, double spread_um) {
  OxygenLight light;
  light.cell_um = cell_um;
  light.spread_um = spread_um;
  for (int level = 0; level < 256; ++level) light.level_mw_cm2.push_back(4.0 * level);
  return light;
}

/// Images this small are no work for several threads.
ExecutionContext one_thread() {
  ExecutionContext context;
  context.threads = 1;
  return context;
}

struct Box {
  int x, y, w, h;
};
OxygenImage image_of(int width, int height, const std::vector<Box>& boxes,
                     std::uint8_t level = 25) {
  OxygenImage image{
      width, height, std::vector<std::uint8_t>(static_cast<std::size_t>(width * height)), {}};
  image.solid = image.level;
  for (const Box& b : boxes) {
    for (int y = b.y; y < b.y + b.h; ++y) {
      for (int x = b.x; x < b.x + b.w; ++x) {
        image.level[static_cast<std::size_t>(y * width + x)] = level;
        image.solid[static_cast<std::size_t>(y * width + x)] = 1;
      }
    }
  }
  return image;
}

TEST(EvenOxygen, EvenLightStays) {
  const EvenOxygen found = detail::even_oxygen(hydrogel(), image_of(20, 15, {{0, 0, 20, 15}}),
                                               light_of(5, 0), 1.8, one_thread());
  for (const std::uint8_t level : found.level) EXPECT_EQ(level, 25);
  // Shares of light are single precision.
  EXPECT_NEAR(found.by_s / inhibition_time_s(hydrogel(), 100), 1, 3e-7);
  EXPECT_EQ(found.brightest, 1);
  EXPECT_EQ(found.judged, 300U);
  // The closed form of the cure is the limit of radicals that start chains at once.
  EXPECT_NEAR(found.before.cure / 300, 1, 0.01);
  EXPECT_NEAR(found.before.missed / 300, 0, 3e-7);
}

TEST(EvenOxygen, ALineMissesWhatTheLinearTheorySays) {
  // A line of 50 um, until just before its light would have used up the oxygen alone.
  const OxygenLight light = light_of(5, 0);
  const double T = 1.19;
  const EvenOxygen found =
      detail::even_oxygen(hydrogel(), image_of(90, 3, {{40, 0, 10, 3}}), light, T, one_thread());
  EXPECT_EQ(found.by_s, T);
  EXPECT_EQ(found.judged, 0U);
  // The outermost cells lie 22.5 um from the middle: the mean of f over a line there is that of two lines,
  // of half widths 25 ± 22.5 um, seen from their middles.
  double used = 0;
  for (const double half : {2.5, 47.5}) {
    used += 0.5 * oxygen_used_mol_l(hydrogel(), 100, FeatureShape::line, half, T);
  }
  const double wanted = radicals_mol_l_s(hydrogel(), 100) * T;
  // On cells of 5 um an edge is known to some percent of what a cell exchanges.
  EXPECT_NEAR(found.before.least, used / wanted, 0.02);
  EXPECT_LT(found.before.least, 0.6);
  EXPECT_GT(found.after.least, 0.97);
  EXPECT_LT(found.after.missed, found.before.missed / 20);
}

/// What gels when under the levels.
PatternRun run_of(const OxygenImage& image, const std::vector<std::uint8_t>& level,
                  const OxygenLight& light) {
  LightPattern p{image.width, image.height, {}};
  for (const std::uint8_t l : level) {
    p.share.push_back(static_cast<float>(light.level_mw_cm2[l] / light.level_mw_cm2.back()));
  }
  return run_pattern(hydrogel(), p, detail::judging_setup(light, 4), one_thread());
}

TEST(EvenOxygen, SmallAndLargeSquaresGelTogether) {
  for (const double spread_um : {0.0, 4.0}) {
    const OxygenLight light = light_of(5, spread_um);
    const OxygenImage image = image_of(72, 54, {{12, 17, 20, 20}, {48, 24, 6, 6}});
    const EvenOxygen found = detail::even_oxygen(hydrogel(), image, light, 1.8, one_thread());
    SCOPED_TRACE(spread_um);
    // 30 and 100 um: without, the small one takes over twice as long.
    EXPECT_GT(run_of(image, image.level, light).gel_time_at(51, 27), 3.4);
    const PatternRun run = run_of(image, found.level, light);
    const double large = run.gel_time_at(22, 27), small = run.gel_time_at(51, 27);
    // The middle of the large one hardly knows of its edges.
    EXPECT_NEAR(large / 1.67257, 1, 0.02);
    // Light that spreads takes from the outermost cells of the small one, and so its middle gets more.
    EXPECT_GT(small / large, spread_um > 0 ? 0.65 : 0.9);
    EXPECT_LT(small / large, 1.05);
    // A few of 436 cells are late, where half of them and more were.
    EXPECT_GT(found.before.behind, 200U);
    EXPECT_LT(found.after.behind, 30U);
    EXPECT_LT(found.after.off, found.before.off / 3);
    EXPECT_GT(found.after.cure / static_cast<double>(found.judged), 0.9);
    EXPECT_EQ(found.after.dark_gelled, 0U);
    EXPECT_EQ(found.solid, 436U);
    for (std::size_t k = 0; k < found.level.size(); ++k) {
      const int least = static_cast<int>(0.75 * image.level[k]);
      EXPECT_GE(found.level[k], image.solid[k] != 0 ? least : 0) << k;
      if (image.solid[k] == 0) {
        EXPECT_EQ(found.level[k], 0) << k;
      }
    }
  }
}

TEST(EvenOxygen, WhatIsBeyondTheLightIsCounted) {
  OxygenLight light = light_of(5, 0);
  light.level_mw_cm2.resize(30);  // to 116
  const EvenOxygen found =
      detail::even_oxygen(hydrogel(), image_of(60, 60, {{28, 28, 4, 4}}), light, 1.8, one_thread());
  EXPECT_EQ(found.short_of_light, 16U);
  EXPECT_NEAR(found.brightest, 1.16, 1e-12);
  for (const std::uint8_t level : found.level) EXPECT_TRUE(level == 0 || level == 29);
}

TEST(EvenOxygen, WhatShinesBesideThePartStays) {
  OxygenImage image = image_of(60, 40, {{15, 10, 12, 20}, {33, 10, 8, 20}});
  for (std::size_t k = 0; k < image.level.size(); ++k) {
    if (k % 60 >= 33) image.solid[k] = 0;
  }
  const EvenOxygen found =
      detail::even_oxygen(hydrogel(), image, light_of(5, 0), 1.8, one_thread());
  const EvenOxygen lone = detail::even_oxygen(hydrogel(), image_of(60, 40, {{15, 10, 12, 20}}),
                                              light_of(5, 0), 1.8, one_thread());
  int less = 0;
  for (std::size_t k = 0; k < image.level.size(); ++k) {
    if (image.solid[k] == 0) {
      EXPECT_EQ(found.level[k], image.level[k]) << k;
    }
    if (k % 60 == 26 && image.solid[k] != 0) less += found.level[k] < lone.level[k];
  }
  // Its neighbour takes oxygen, too, so that edge needs less light.
  EXPECT_EQ(less, 20);
}

TEST(EvenOxygen, LevelsOfPlateausAreTheLowest) {
  OxygenLight light = light_of(5, 0);
  for (int level = 60; level < 256; ++level) {
    light.level_mw_cm2[static_cast<std::size_t>(level)] = 240;
  }
  const EvenOxygen found =
      detail::even_oxygen(hydrogel(), image_of(40, 40, {{18, 18, 3, 3}}), light, 1.8, one_thread());
  EXPECT_EQ(*std::max_element(found.level.begin(), found.level.end()), 60);
}

TEST(EvenOxygen, CanBeStopped) {
  const std::atomic<bool> stop = true;
  ExecutionContext context;
  context.cancel = &stop;
  EXPECT_THROW(detail::even_oxygen(hydrogel(), image_of(24, 20, {{6, 5, 10, 5}}), light_of(5, 6),
                                   1.8, context),
               Cancelled);
}

TEST(EvenOxygen, ReachGoesWithDiffusion) {
  // 2.5 sqrt(4 D T) of the time in which full light uses oxygen up, or of the exposure.
  const OxygenLight light = light_of(5, 0);
  const double T = inhibition_time_s(hydrogel(), 1020);
  EXPECT_EQ(detail::oxygen_reach(hydrogel(), light, 5),
            static_cast<int>(std::ceil(2.5 * std::sqrt(4 * 277.253 * T) / 5)) + 1);
  EXPECT_LT(detail::oxygen_reach(hydrogel(), light, T / 9),
            detail::oxygen_reach(hydrogel(), light, 5));
}

}  // namespace
}  // namespace slicecorr
