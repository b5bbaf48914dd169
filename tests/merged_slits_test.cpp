// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Gaps of one slice that are let close: for every model the levels are those of a design without these
// gaps, and what is said to be covered stays the design's own.

#include <gtest/gtest.h>

#include <random>
#include <vector>

#include "gel_time_models.hpp"
#include "models.hpp"
#include "rounds.hpp"
#include "slicecorr/correct.hpp"

namespace slicecorr {
namespace {

using Rows = std::vector<std::vector<std::uint8_t>>;  ///< by layer

/// Features, gaps of any height, many of one layer, and greys.
Rows random_design(std::mt19937& random, int layers, std::size_t columns) {
  Rows rows(static_cast<std::size_t>(layers), std::vector<std::uint8_t>(columns, 0));
  for (std::size_t i = 0; i < columns; ++i) {
    bool full = random() % 2;
    for (int n = 0; n < layers;) {
      const int high = full ? 1 + static_cast<int>(random() % 6)
                            : 1 + (random() % 3 ? 0 : static_cast<int>(random() % 5));
      for (int k = 0; k < high && n < layers; ++k, ++n) {
        const bool grey = random() % 12 == 0;
        rows[static_cast<std::size_t>(n)][i] = grey ? static_cast<std::uint8_t>(1 + random() % 254)
                                               : full ? 255
                                                      : 0;
      }
      full = !full;
    }
  }
  return rows;
}

/// The rule, said once more: by the layers beside it as the design has them.
Rows closed(const Rows& design) {
  Rows rows = design;
  for (std::size_t n = 1; n + 1 < design.size(); ++n) {
    for (std::size_t i = 0; i < rows[n].size(); ++i) {
      if (design[n - 1][i] == 255 && design[n][i] == 0 && design[n + 1][i] == 255) rows[n][i] = 255;
    }
  }
  return rows;
}

struct Solved {
  Rows levels, coverage;
  std::vector<bool> dark;
};

Solved solve(const CorrectionPlan& plan, const Rows& design) {
  const std::size_t columns = design.front().size();
  BandCorrector band(plan, columns);
  for (const auto& row : design) band.add_layer(row.data());
  const auto all = static_cast<std::size_t>(plan.all_layers);
  Solved s{Rows(all), Rows(all), std::vector<bool>(all)};
  band.solve([&](int n, const std::uint8_t* levels, const std::uint8_t* coverage, bool dark) {
    const auto k = static_cast<std::size_t>(n);
    s.levels[k].assign(levels, levels + columns);
    s.coverage[k].assign(coverage, coverage + columns);
    s.dark[k] = dark;
  });
  return s;
}

TEST(MergedSlits, LevelsAreThoseOfADesignWithoutThem) {
  std::mt19937 random(20261128);
  for (int round = 0; round < test::rounds(6); ++round) {
    for (const bool layerwise : {false, true}) {
      for (const bool gel_time : {false, true}) {
        Process open = test::process(800);
        if (layerwise) {
          open.mode = ExposureMode::layerwise;
          open.exposure_s = 5;
        }
        const CureModel model =
            make_cure_model(test::linear_printer(1, 100),
                            gel_time ? test::bright_resin(300) : test::resin(100, 300), open, 50);
        Process merge = open;
        merge.one_slice_gaps = OneSliceGaps::merge;
        const int layers = 40;
        const Rows design = random_design(random, layers, 70), without = closed(design);
        ASSERT_NE(design, without);
        const CorrectionPlan merging = test::plan_for(model, merge, layers),
                             plain = test::plan_for(model, open, layers);
        const Solved got = solve(merging, design), want = solve(plain, without);
        EXPECT_EQ(got.levels, want.levels) << layerwise << gel_time;
        for (std::size_t n = 0; n < got.coverage.size(); ++n) {
          const auto own = n < design.size() ? design[n] : std::vector<std::uint8_t>(70, 0);
          EXPECT_EQ(got.coverage[n], own);
          bool any = false;
          for (std::size_t i = 0; i < 70; ++i) any = any || own[i] || got.levels[n][i];
          EXPECT_EQ(got.dark[n], !any);
        }
        // A column by itself.
        std::vector<std::uint8_t> column;
        for (const auto& row : design) column.push_back(row[3]);
        std::vector<std::uint8_t> levels;
        for (const auto& row : got.levels) levels.push_back(row[3]);
        EXPECT_EQ(solve_column(merging, column), levels);
      }
    }
  }
}

}  // namespace
}  // namespace slicecorr
