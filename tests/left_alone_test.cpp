// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// What is shown as it is beside a part: supports, rafts. Doses in closed form, then figures.
#include "slicecorr/left_alone.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "memory_slices.hpp"
#include "models.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/pipeline.hpp"

namespace slicecorr {
namespace {

using test::column;
using test::MemorySlices;
using Column = std::vector<std::uint8_t>;

/// `left_alone`: empty: nothing is, and it is solved as nothing could be.
Column corrected(const CorrectionPlan& plan, const Column& coverage, const Column& left_alone,
                 const Column& heights = {}) {
  BandCorrector band(plan, 1, !left_alone.empty());
  for (std::size_t n = 0; n < coverage.size(); ++n) {
    band.add_layer(&coverage[n], n < heights.size() ? &heights[n] : nullptr,
                   left_alone.empty() ? nullptr : &left_alone[n]);
  }
  Column levels(static_cast<std::size_t>(plan.all_layers));
  band.solve([&](int n, const std::uint8_t* level, const std::uint8_t*, bool) {
    levels[static_cast<std::size_t>(n)] = *level;
  });
  return levels;
}

/// Doses at nodes from the levels, slice by slice from the sum itself.
std::vector<double> node_sums(const CureModel& model, const Column& levels) {
  std::vector<double> omega(levels.size() + 1, 0.0);
  for (std::size_t k = 0; k < levels.size(); ++k) {
    for (std::size_t n = k; n < levels.size(); ++n) {
      omega[k] += model.level_phi[levels[n]] * model.one_minus_a *
                  std::pow(model.a, static_cast<double>(n - k));
    }
  }
  return omega;
}

Column at(int layers, int first, int last, std::uint8_t value) {
  Column c(static_cast<std::size_t>(layers), 0);
  for (int n = first; n <= last; ++n) c[static_cast<std::size_t>(n)] = value;
  return c;
}

TEST(LeftAlone, FeatureAboveAGapAboveASupport) {
  // From the platform: a feature to node 30, a gap of five slices, ten slices of a support.
  const CureModel model = test::figure_2_2();
  const auto coverage = column(45, {{10, 29}});
  const CorrectionPlan plan = test::plan_for(model, test::process(1000), 45);
  for (const int grey : {40, 60, 90}) {
    const Column left = at(45, 35, 44, static_cast<std::uint8_t>(grey));
    const Column levels = corrected(plan, coverage, left);
    for (int n = 35; n < 45; ++n) EXPECT_EQ(levels[static_cast<std::size_t>(n)], grey) << n;
    const auto omega = node_sums(model, levels);
    // After the support nothing is shown but black: its light and that, in closed form.
    const double a10 = std::pow(model.a, 10);
    const double after =
        model.phi_min() * (1 - std::pow(model.a, static_cast<double>(levels.size()) - 45));
    EXPECT_NEAR(omega[35],
                model.level_phi[static_cast<std::size_t>(grey)] * (1 - a10) + a10 * after, 1e-12);
    // The gap brings the dose from there to 1 at the feature's edge: as near as edges are aimed at,
    // where full light makes a dose rise the fastest.
    const double fall = model.eta * std::log(10.0);
    const double tolerance_um = std::max(0.05, std::min(model.level_step_um() / 25, 0.5));
    EXPECT_NEAR(omega[30], 1.0, (model.phi_max() - 1) * fall * tolerance_um / 50);
    const ColumnDose dose = column_dose(model, levels);
    for (std::size_t n = 0; n < 35; ++n) {
      EXPECT_EQ(dose.middle[n] >= 1.0, coverage[n] == 255) << grey << " layer " << n;
    }
  }
}

TEST(LeftAlone, WhatLiesBeforeASupportKnowsWhatLiesBehindIt) {
  // A feature of the part, then a thin support, a gap and a feature behind it: full light up to the
  // support would cure the gap through.
  const CureModel model = test::figure_2_2();
  const auto coverage = column(80, {{30, 49}, {60, 79}});
  const Column left = at(80, 55, 59, 20);
  const CorrectionPlan plan = test::plan_for(model, test::process(1000), 80);
  const ColumnDose dose = column_dose(model, corrected(plan, coverage, left));
  for (std::size_t n = 0; n < 80; ++n) {
    if (left[n]) continue;
    EXPECT_EQ(dose.middle[n] >= 1.0, coverage[n] == 255) << n;
  }
  // Where the support stands on the platform, the feature may be as bright as it gets.
  const auto alone = corrected(plan, column(80, {{60, 79}}), at(80, 0, 59, 20));
  const ColumnDose bright = column_dose(model, alone);
  EXPECT_EQ(alone[60], 255);
  EXPECT_GT(bright.upper[60], dose.upper[60]);
}

// One definition, two loops: that of plain columns carries the dose in registers and knows runs from a log
// (continuous.cpp), the other walks any column.
TEST(LeftAlone, NothingLeftAloneGivesTheLevelsOfAPlainCorrection) {
  std::mt19937 random(2);
  for (int k = 0; k < 60; ++k) {
    Column coverage;
    // In every fourth column features and gaps of one to three slices in turn: what is at one edge follows
    // from dozens of others.
    const bool thin = k % 4 == 0;
    while (coverage.size() < 90) {
      const std::uint8_t kinds[]{0, 255, 0, 255, static_cast<std::uint8_t>(random() % 256)};
      const std::uint8_t other = coverage.empty() || coverage.back() == 0 ? 255 : 0;
      coverage.insert(coverage.end(), 1 + random() % (thin ? 3 : 14),
                      thin ? other : kinds[random() % 5]);
    }
    coverage.resize(90);
    Column heights(91, 0);
    for (std::size_t n = 1; n < 90; ++n) {
      const bool edge = coverage[n] != coverage[n - 1] &&
                        (coverage[n] == 0 || coverage[n] == 255) &&
                        (coverage[n - 1] == 0 || coverage[n - 1] == 255);
      if (edge && k % 2) heights[n] = static_cast<std::uint8_t>(1 + random() % 255);
    }
    const CorrectionPlan plan =
        test::plan_for(test::figure_2_2(), test::process(1000, k % 3 ? 1e300 : 2), 90);
    const Column walked = corrected(plan, coverage, Column(90, 0), heights);
    EXPECT_EQ(walked, corrected(plan, coverage, {}, heights)) << k;
    EXPECT_EQ(walked, solve_column(plan, coverage, heights)) << k;
  }
}

/// Random runs of three slices and more: features, gaps and what is left alone, of `grey` after each
/// kind of run (0: nothing is left alone there).
void random_column(std::mt19937& random, int after_gap, int after_feature, Column& coverage,
                   Column& left) {
  coverage.clear();
  left.clear();
  int last = 0;  // 0 gap, 1 feature, 2 left alone
  while (coverage.size() < 120) {
    const std::size_t count = 3 + random() % 15;
    auto kind = static_cast<int>(random() % 3);
    const int grey = last == 1 ? after_feature : after_gap;
    if (kind == 2 && (grey == 0 || last == 2)) kind = 0;
    coverage.insert(coverage.end(), count, kind == 1 ? 255 : 0);
    left.insert(left.end(), count, static_cast<std::uint8_t>(kind == 2 ? grey : 0));
    last = kind;
  }
  coverage.resize(120);
  left.resize(120);
}

TEST(LeftAlone, RandomColumnsPrint) {
  for (const auto& [depth_um, reflectance] :
       {std::pair{0.0, 0.0}, {4000.0, 0.0}, {0.0, 0.1}, {4000.0, 0.1}}) {
    Printer printer = test::linear_printer(1, 100);
    printer.resin_depth_um = depth_um;
    printer.platform_reflectance = reflectance;
    const CureModel model =
        make_cure_model(printer, test::resin(576, 2000), test::process(1000), 50);
    const CorrectionPlan plan = test::plan_for(model, test::process(1000), 120);
    std::mt19937 random(9);
    Column coverage, left;
    for (int k = 0; k < 150; ++k) {
      // Supports of full light that stand on features, and dim ones with a gap behind them: of both
      // all features print, and of the latter all gaps stay open.
      const bool bright = k % 2 != 0;
      random_column(random, bright ? 0 : 20, bright ? 255 : 0, coverage, left);
      const Column levels = corrected(plan, coverage, left);
      const ColumnDose dose = column_dose(model, levels);
      for (std::size_t n = 0; n < 120; ++n) {
        if (left[n]) {
          ASSERT_EQ(levels[n], left[n]);
        } else if (coverage[n] == 255 || !bright) {
          EXPECT_EQ(dose.middle[n] >= 1.0, coverage[n] == 255)
              << depth_um << " " << reflectance << " column " << k << " layer " << n << ": "
              << dose.middle[n];
        }
      }
    }
  }
}

TEST(LeftAlone, LayerByLayer) {
  Process process;
  process.mode = ExposureMode::layerwise;
  process.exposure_s = 60;
  const CureModel model =
      make_cure_model(test::linear_printer(1, 100), test::resin(576, 200), process, 50);
  const auto coverage = column(40, {{5, 14}, {30, 39}});
  const Column left = at(40, 20, 29, 200);
  const CorrectionPlan plan = test::plan_for(model, process, 40);
  const Column levels = corrected(plan, coverage, left);
  for (std::size_t n = 20; n < 30; ++n) EXPECT_EQ(levels[n], 200) << n;
  for (std::size_t n = 15; n < 20; ++n) EXPECT_EQ(levels[n], 0) << n;
  const ColumnDose dose = column_dose(model, levels);
  for (std::size_t n = 0; n < 40; ++n) {
    EXPECT_TRUE(coverage[n] == 0 || dose.upper[n] >= 1.0) << n;
  }
}

// Whatever the surface does between the two; to a gap the same feature has an edge.
TEST(LeftAlone, LayerByLayerNoEdgeLiesBelowIt) {
  Process process;
  process.mode = ExposureMode::layerwise;
  process.exposure_s = 0.5;
  const CureModel model =
      make_cure_model(test::linear_printer(1, 100), test::resin(576, 200), process, 50);
  const CorrectionPlan plan = test::plan_for(model, process, 40);
  const Column coverage = column(40, {{5, 14}, {30, 39}});
  const Column left = at(40, 20, 29, 200);
  Column heights(41, 0);
  heights[30] = 200;
  EXPECT_EQ(corrected(plan, coverage, left, heights), corrected(plan, coverage, left));
  EXPECT_NE(corrected(plan, coverage, {}, heights), corrected(plan, coverage, {}));
}

Grid grid_of(int width, int height, int layers) {
  Grid g;
  g.width_px = width;
  g.height_px = height;
  g.layers = layers;
  g.pixel_x_um = g.pixel_y_um = g.layer_um = 50;
  return g;
}

Setup setup_of(double reflectance = 0) {
  Setup setup;
  setup.printer = test::linear_printer(1, 100);
  setup.printer.platform_reflectance = reflectance;
  setup.resin = test::resin(576, 2000);
  setup.process = test::process(1000);
  return setup;
}

TEST(LeftAlone, WhoGetsAVoxel) {
  MemorySlices part(grid_of(16, 16, 1)), support(grid_of(16, 16, 1));
  const std::uint8_t cases[][4]{// part, left alone; target then, shown
                                {255, 0, 255, 0},   {0, 255, 0, 255},   {255, 255, 0, 255},
                                {255, 127, 255, 0}, {255, 128, 0, 255}, {100, 60, 0, 100},
                                {100, 49, 100, 0},  {40, 90, 0, 90},    {0, 0, 0, 0},
                                {0, 1, 0, 1}};
  for (int i = 0; i < 10; ++i) {
    part.at(0, i, 0) = cases[i][0];
    support.at(0, i, 0) = cases[i][1];
  }
  const LeavingAlone target(part, {{&support, "supports", false}});
  const MemorySlices rest(target), shown(*target.left_alone());
  const AsSliced sliced(target);
  const MemorySlices all(sliced);
  for (int i = 0; i < 10; ++i) {
    EXPECT_EQ(rest.at(0, i, 0), cases[i][2]) << i;
    EXPECT_EQ(shown.at(0, i, 0), cases[i][3]) << i;
    EXPECT_EQ(all.at(0, i, 0), std::max(cases[i][2], cases[i][3])) << i;
  }
  EXPECT_EQ(target.bounds().x0, 0);
  EXPECT_EQ(target.bounds().x1, 10);
}

TEST(LeftAlone, OtherGridsAreRefused) {
  const MemorySlices part(grid_of(16, 16, 10));
  const auto refused = [&](const Grid& grid, bool may_end_early, const std::string& word) {
    const MemorySlices other(grid);
    try {
      const LeavingAlone target(part, {{&other, "supports.uvj", may_end_early}});
      ADD_FAILURE() << word;
    } catch (const InputError& e) {
      EXPECT_NE(std::string(e.what()).find("supports.uvj"), std::string::npos) << e.what();
      EXPECT_NE(std::string(e.what()).find(word), std::string::npos) << e.what();
    }
  };
  refused(grid_of(15, 16, 10), false, "15 x 16 pixels");
  refused(grid_of(16, 16, 9), false, "9 slices");
  refused(grid_of(16, 16, 11), true, "11 slices");
  Grid pitch = grid_of(16, 16, 10);
  pitch.pixel_y_um = 51;
  refused(pitch, false, "voxels of 50 x 51 x 50");
  const MemorySlices lower(grid_of(16, 16, 9));
  EXPECT_NO_THROW(LeavingAlone(part, {{&lower, "raft.stl", true}}));
}

TEST(LeftAlone, FiguresCountItApart) {
  // A bridge of the part over the middle, held by a pillar that is left alone.
  const int layers = 60;
  MemorySlices part(grid_of(16, 16, layers)), support(grid_of(16, 16, layers));
  for (int n = 0; n < layers; ++n) {
    for (int y = 4; y < 12; ++y) {
      for (int x = 2; x < 14; ++x) {
        const bool leg = x < 4 || x >= 12, deck = n >= 40;
        part.at(n, x, y) = leg || deck ? 255 : 0;
        const bool pillar = x == 8 && (y == 7 || y == 8) && n >= 20 && n < 40;
        if (pillar) support.at(n, x, y) = 30;
      }
    }
  }
  const LeavingAlone target(part, {{&support, "pillar", false}});
  for (const double reflectance : {0.0, 0.2}) {
    const auto setup = setup_of(reflectance);
    const CorrectedSlices shown(target, setup);
    const MemorySlices stack(shown);
    for (int n = 20; n < 40; ++n) EXPECT_EQ(stack.at(n, 8, 7), 30) << n;
    const Prediction p = verify_stack(stack, target, setup);
    EXPECT_EQ(p.left_alone_voxels, 40U);
    EXPECT_EQ(p.cure_through_voxels, 0U) << reflectance;
    EXPECT_EQ(p.undercure_voxels, 0U);
    EXPECT_EQ(p.lost_features, 0U);
    EXPECT_EQ(p.grey_voxels, 0U);
    // Each column of the deck has a gap below it, of the pillar's the part below the pillar. The
    // pillar's two have no edge: nothing of the design ends where it touches.
    EXPECT_EQ(p.gaps, 8U * 8U);
    EXPECT_EQ(p.height_error_um.count(),
              verify_stack(MemorySlices(CorrectedSlices(part, setup)), part, setup)
                      .height_error_um.count() -
                  2);
    EXPECT_LT(p.height_error_um.greatest(), 1.0);
    // As the part alone, but for the columns of the pillar.
    const CorrectedSlices without(part, setup);
    const MemorySlices plain(without);
    for (int n = 0; n < layers; ++n) {
      for (int y = 4; y < 12; ++y) {
        for (int x = 2; x < 14; ++x) {
          if (x == 8 && (y == 7 || y == 8)) continue;
          ASSERT_EQ(stack.at(n, x, y), plain.at(n, x, y)) << n;
        }
      }
    }
  }
}

}  // namespace
}  // namespace slicecorr
