// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// The distinct columns of a part and its heights, what predictions tell of them, and speeds within
/// limits.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <random>

#include "plan/closed.hpp"
#include "plan/design_columns.hpp"
#include "plan_parts.hpp"
#include "refusal.hpp"
#include "rounds.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/plan.hpp"

namespace slicecorr::test {
namespace {

using testing::HasSubstr;

TEST(PlanSchedule, SpeedsStayWithinLimitsAndAcceleration) {
  std::mt19937 random(34);
  std::uniform_real_distribution<double> share(0, 1);
  for (int round = 0; round < rounds(50); ++round) {
    std::vector<double> limits;
    for (int n = 0; n < 60; ++n) {
      limits.push_back(share(random) < 0.2 ? 200 + 3000 * share(random)
                                           : std::numeric_limits<double>::infinity());
    }
    const double acceleration = 0.02 + 2 * share(random), layer_um = 20 + 80 * share(random);
    const auto speeds = speeds_within(limits, 3000, acceleration, layer_um);
    ASSERT_EQ(speeds.size(), limits.size());
    const double change = 2 * acceleration * layer_um * 1e-3;  // mm²/s²
    const auto squared = [](double mm_h) { return mm_h * mm_h / (3600.0 * 3600.0); };
    for (std::size_t n = 0; n < speeds.size(); ++n) {
      EXPECT_LE(speeds[n], std::min(limits[n], 3000.0));
      // The greatest such speeds: each is that of some slice's limit, seen from there.
      double most = 3000;
      for (std::size_t k = 0; k < limits.size(); ++k) {
        const double away = std::abs(static_cast<double>(n) - static_cast<double>(k));
        most =
            std::min(most, 3600 * std::sqrt(squared(std::min(limits[k], 3000.0)) + away * change));
      }
      // Six digits.
      EXPECT_NEAR(speeds[n], most, 1e-5 * most);
      if (n > 0) {
        EXPECT_LE(std::abs(squared(speeds[n]) - squared(speeds[n - 1])),
                  change + 2e-5 * squared(3000));
      }
    }
  }
  EXPECT_THAT(refusal([] { speeds_within({100}, 100, 0, 50); }), HasSubstr("acceleration"));
  EXPECT_THAT(refusal([] { speeds_within({0}, 100, 1, 50); }), HasSubstr("no speed"));
}

// ------------------------------------------------------------------------- columns

TEST(DesignColumns, AreThoseOfThePart) {
  std::mt19937 random(32);
  MemorySlices part({40, 30, 25, 50, 50, 50});
  std::map<std::vector<std::uint8_t>, std::uint64_t> direct;
  for (int y = 0; y < 30; ++y) {
    for (int x = 0; x < 40; ++x) {
      std::vector<std::uint8_t> column(25, 0);
      const int kind = static_cast<int>(random() % 5);
      for (int n = kind; n < 20; ++n) column[n] = n % (kind + 2) == 0 ? 0 : 255;
      if (kind == 3) column[10] = 99;
      if (random() % 4 == 0) column.assign(25, 0);
      for (int n = 0; n < 25; ++n) part.at(n, x, y) = column[n];
      if (std::count(column.begin(), column.end(), 255) > 0) ++direct[column];
    }
  }
  const detail::DesignColumns columns(part, {});
  ASSERT_EQ(columns.columns().size(), direct.size());
  std::vector<std::uint32_t> all(direct.size());
  for (std::size_t k = 0; k < all.size(); ++k) all[k] = static_cast<std::uint32_t>(k);
  std::vector<std::vector<std::uint8_t>> read(all.size());
  columns.reader(all)([&](int, const std::uint8_t* rows, const std::uint8_t* heights) {
    EXPECT_EQ(heights, nullptr);
    for (std::size_t k = 0; k < all.size(); ++k) read[k].push_back(rows[k]);
  });
  for (std::size_t k = 0; k < all.size(); ++k) {
    ASSERT_TRUE(direct.contains(read[k]));
    EXPECT_EQ(columns.columns()[k].pixels, direct[read[k]]);
    // The pixel that is named has it.
    for (int n = 0; n < 25; ++n) {
      EXPECT_EQ(part.at(n, columns.columns()[k].x, columns.columns()[k].y), read[k][n]);
    }
  }
}

TEST(DesignColumns, HeightsAreThoseOfGapsAndFeatures) {
  MemorySlices part = comb({{{2, 5}, {8, 8}, {12, 19}}}, 20);
  part.at(9, 0, 0) = 40;  // grey below the feature of one slice
  const detail::DesignColumns columns(part, {});
  const detail::PartHeights h = detail::heights_of(columns, 2);
  ASSERT_EQ(h.gaps.size(), 3U);
  EXPECT_EQ(h.gaps[0].slices, 2);
  EXPECT_TRUE(h.gaps[0].at_platform != h.gaps[1].at_platform);
  EXPECT_EQ(h.gaps[2].slices, 3);
  EXPECT_TRUE(h.gaps[2].beside_grey);
  EXPECT_EQ(h.gaps[2].place.first, 9);
  EXPECT_EQ(h.gaps[2].place.last, 11);
  ASSERT_EQ(h.features.size(), 3U);
  EXPECT_EQ(h.features[0].slices, 1);
  EXPECT_EQ(h.features[0].place.first, 8);
  EXPECT_EQ(h.features[2].slices, 8);
  EXPECT_EQ(h.lowest_gap[0], 2);
}

TEST(PredictTells, RunsAndGapsAreThoseOfTheFigures) {
  const CureModel model = figure_2_2();
  const PixelCurve curve = pixel_curve(model);
  std::mt19937 random(33);
  constexpr int kLayers = 40, kColumns = 130;
  BandPredictor predictor(model, curve, kLayers, kColumns);
  Histogram contrasts;
  std::uint64_t runs = 0, lost = 0, split = 0, gaps = 0;
  predictor.tell_gaps([&](std::size_t, int first, int last, double least) {
    EXPECT_LE(first, last);
    ++gaps;
    contrasts.add(std::max(0.0, 1 - least));
  });
  predictor.tell_runs([&](std::size_t, int first, int last, bool is_lost, bool is_split) {
    EXPECT_LE(first, last);
    ++runs;
    lost += is_lost;
    split += is_split;
  });
  std::vector<std::uint8_t> pixels(kColumns), coverage(kColumns, 0);
  for (int n = kLayers; n-- > 0;) {
    for (int i = 0; i < kColumns; ++i) {
      pixels[i] = static_cast<std::uint8_t>(random() % 256);
      if (random() % 4 == 0) coverage[i] = coverage[i] ? 0 : 255;
    }
    predictor.add_slice(n, pixels.data(), coverage.data());
  }
  const Prediction p = predictor.finish(0, 0, kColumns);
  EXPECT_GT(p.gaps, 50U);
  EXPECT_EQ(gaps, p.gaps);
  EXPECT_EQ(runs, p.runs);
  EXPECT_EQ(lost, p.lost_features);
  EXPECT_EQ(split, p.split_features);
  EXPECT_EQ(contrasts.least(), p.gap_contrast.least());
  EXPECT_EQ(contrasts.scaled_sum(), p.gap_contrast.scaled_sum());
}

}  // namespace
}  // namespace slicecorr::test
