// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// The stages of the correction under UV light, each by itself: what a column asks for, the doses
// of its levels, and the error by which levels are compared.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "correct/inhibited_column.hpp"
#include "correct/inhibited_doses.hpp"
#include "correct/inhibited_judge.hpp"
#include "correct/inhibited_polish.hpp"
#include "correct/inhibited_rule.hpp"
#include "slicecorr/dose.hpp"
#include "uv_models.hpp"

namespace slicecorr::detail {
namespace {

using namespace test::uv;

constexpr int kLayers = 40;

Process layerwise_process() {
  Process p = uv_process(0, 200);
  p.mode = ExposureMode::layerwise;
  p.exposure_s = 1.2;
  return p;
}

struct Stages {
  explicit Stages(const CureModel& m, bool merge = false, const InhibitedTuning& tuning = {})
      : model(m), plan(m, merge, kLayers, slices_with_burst(m, kLayers, kLayers - 1), tuning) {}
  CureModel model;
  InhibitedPlan plan;
  ColumnDesign design{plan};
  ColumnDoses doses{plan};
  ColumnJudge judge{plan, design, doses};
};

CureModel continuous() { return model_of(resin_1(), uv_process(1000, 200), 50); }

TEST(InhibitedDesign, WhatIsLeftAloneGelsWhereAFeatureHangsOnIt) {
  Stages s(continuous());
  ColumnBounds bounds;
  bounds.left_alone = {{0, 10, 255}, {20, 21, 255}};
  s.design.ask(bounds);
  const double inside = s.plan.inside;
  const auto demand = [&](int k) { return s.design.demand[static_cast<std::size_t>(k)]; };
  // On a pillar; on a single layer above a gap, which holds nothing. Edges are tried several times.
  for (int round = 0; round < 2; ++round) {
    s.design.read({{10, 14, 255}, {21, 24, 255}});
    EXPECT_TRUE(s.design.left_alone(8));
    EXPECT_FALSE(s.design.left_alone(9));
    EXPECT_TRUE(s.design.full(9));
    EXPECT_TRUE(s.design.left_alone(20));
    EXPECT_EQ(demand(8), 0.0);
    EXPECT_EQ(demand(9), inside);
    EXPECT_EQ(demand(10), inside);
    EXPECT_EQ(demand(14), 1.0);
    EXPECT_EQ(demand(21), inside);
    ASSERT_EQ(s.design.edges.size(), 2U);
    EXPECT_EQ(s.design.edges[0].node, 14);
    EXPECT_EQ(s.design.edges[1].node, 24);
  }
}

TEST(InhibitedDesign, DemandsOfEdgesInsidesAndGreyLayers) {
  Stages s(continuous());
  // On the platform; full with a grey end; grey alone.
  s.design.read({{0, 3, 255}, {10, 13, 255}, {13, 14, 204}, {20, 21, 51}, {21, 22, 102}});
  const double inside = s.plan.inside;
  EXPECT_EQ(inside, InhibitedTuning{}.inside_dose);
  const auto demand = [&](int k) { return s.design.demand[static_cast<std::size_t>(k)]; };
  EXPECT_EQ(demand(0), inside);  // it hangs on the platform
  EXPECT_EQ(demand(1), inside);
  EXPECT_EQ(demand(2), inside);
  EXPECT_EQ(demand(3), 1.0);
  EXPECT_EQ(demand(4), 0.0);
  EXPECT_EQ(demand(10), 1.0);
  EXPECT_EQ(demand(13), 1.0);
  EXPECT_DOUBLE_EQ(demand(14), 2 * 0.8 - 1);
  EXPECT_EQ(demand(20), 0.0);
  EXPECT_DOUBLE_EQ(demand(21), 0.2);
  EXPECT_DOUBLE_EQ(demand(22), 0.4);
  EXPECT_EQ(s.design.last_node, 22);

  ASSERT_EQ(s.design.features.size(), 3U);
  EXPECT_TRUE(s.design.features[0].platform);
  EXPECT_TRUE(s.design.features[0].full);
  EXPECT_EQ(s.design.features[1].upper, 10);
  EXPECT_EQ(s.design.features[1].lower, 14);
  EXPECT_FALSE(s.design.features[1].full);
  // The platform is no edge, nor is where grey begins.
  ASSERT_EQ(s.design.edges.size(), 2U);
  EXPECT_EQ(s.design.edges[0].node, 3);
  EXPECT_FALSE(s.design.edges[0].upper);
  EXPECT_EQ(s.design.edges[1].node, 10);
  EXPECT_TRUE(s.design.edges[1].upper);
}

TEST(InhibitedDesign, AGapOfOneLayerIsOpenOrMerged) {
  const std::vector<CoverageRun> runs{{5, 10, 255}, {11, 16, 255}};
  InhibitedTuning tuning;
  tuning.slit_edge_dose = 0.9;
  tuning.slit_inner_dose = 1.2;
  Stages open(continuous(), false, tuning);
  open.design.read(runs);
  EXPECT_EQ(open.design.features.size(), 2U);
  EXPECT_EQ(open.design.edges.size(), 4U);
  EXPECT_EQ(open.design.demand[9], 1.2);
  EXPECT_EQ(open.design.demand[10], 0.9);
  EXPECT_EQ(open.design.demand[11], 1.0);
  Stages merged(continuous(), true);
  merged.design.read(runs);
  EXPECT_EQ(merged.design.features.size(), 1U);
  EXPECT_EQ(merged.design.edges.size(), 2U);
  EXPECT_EQ(merged.design.demand[10], merged.plan.inside);
}

TEST(InhibitedDoses, AreThoseOfTheModel) {
  // Levels that are changed to and fro, and summed anew at the end, against the model's own doses.
  std::mt19937 random(7);
  for (const Process& process : {uv_process(1000, 200), layerwise_process()}) {
    Stages s(model_of(resin_1(), process, 50));
    const bool sampled = process.mode == ExposureMode::layerwise;
    const auto slices = static_cast<std::size_t>(s.plan.all_layers);
    std::vector<std::uint8_t> levels(slices + 1, 0);
    for (std::size_t n = 0; n < slices; ++n) levels[n] = static_cast<std::uint8_t>(random() % 256);
    s.doses.take(levels, sampled);
    for (int i = 0; i < 200; ++i) {
      s.doses.change(static_cast<int>(random() % slices), static_cast<int>(random() % 256));
    }
    std::vector<double> changed;
    const int near_end = s.plan.all_layers - s.plan.near;
    for (int k = near_end; k < s.plan.all_layers; ++k) changed.push_back(s.doses.node(k));
    s.doses.rebuild();
    levels = s.doses.levels();
    levels.resize(slices);
    const ColumnDose of_model = column_dose(s.model, levels);
    for (int k = 0; k < s.plan.all_layers; ++k) {
      const auto i = static_cast<std::size_t>(k);
      // Both add the same table entries, in another order: rounding only.
      EXPECT_NEAR(s.doses.node(k), of_model.upper[i], 1e-9 * of_model.upper[i]) << k;
      EXPECT_NEAR(s.doses.middle(k), of_model.middle[i], 1e-9 * of_model.middle[i]) << k;
      if (k >= near_end) {
        EXPECT_NEAR(changed[static_cast<std::size_t>(k - near_end)], of_model.upper[i],
                    1e-9 * of_model.upper[i]);
      }
      // The middle and the upper end are samples, in single numbers: 16 sums of 2^-24 each.
      if (sampled) {
        EXPECT_LE(s.doses.least_sampled(k),
                  std::min(of_model.upper[i], of_model.middle[i]) * (1 + 1e-5));
      }
    }
  }
}

TEST(InhibitedJudge, CountsWhatIsWrong) {
  for (const Process& process : {uv_process(1000, 200), layerwise_process()}) {
    Stages s(model_of(resin_1(), process, 50));
    const InhibitedTuning& t = s.plan.tuning;
    s.design.read({{10, 20, 255}});
    // All black: ten voxels are lost, and both edges are nowhere.
    s.doses.clear();
    const ColumnJudge::Score black = s.judge.score(1e300);
    EXPECT_FALSE(black.perfect);
    EXPECT_TRUE(s.judge.dips().empty());
    EXPECT_DOUBLE_EQ(black.um, (10 * t.lost_voxel_layers + 2 * t.most_edge_layers) * 50);
    // No column of that error is better than one of less.
    EXPECT_TRUE(std::isinf(s.judge.score(black.um).um));
  }
}

TEST(InhibitedJudge, FindsWhereAFeatureComesApart) {
  Stages s(continuous());
  s.design.read({{5, 35, 255}});
  LevelRule rule(s.plan, s.design, s.doses);
  rule.choose();
  ASSERT_TRUE(s.judge.score(1e300).perfect);
  EXPECT_TRUE(s.judge.dips().empty());
  // Black slices leave a crack above them; bright ones after it print a second piece.
  std::vector<std::uint8_t> levels = s.doses.levels();
  std::fill(levels.begin() + 22, levels.begin() + 28, std::uint8_t{0});
  std::fill(levels.begin() + 5, levels.begin() + 17, std::uint8_t{255});
  s.doses.take(levels, false);
  const double cracked_um = s.judge.score(1e300).um;
  ASSERT_EQ(s.judge.dips().size(), 1U);
  const ColumnJudge::Dip dip = s.judge.dips()[0];
  EXPECT_LT(dip.least, 1.0);
  EXPECT_GT(cracked_um, s.plan.tuning.split_layers * 50);
  // No other layer between the pieces has less.
  for (int k = 14; k < 28; ++k) {
    EXPECT_GE(s.doses.middle(k), dip.least) << k;
    EXPECT_GE(s.doses.node(k), dip.least) << k;
  }
  EXPECT_LE(dip.least, s.doses.middle(dip.layer));
}

TEST(InhibitedPolish, MendsVoxels) {
  Stages s(continuous());
  s.design.read({{8, 10, 255}, {12, 14, 255}, {16, 18, 255}});
  LevelRule rule(s.plan, s.design, s.doses);
  rule.choose();
  const double before_um = s.judge.score(1e300).um;
  ColumnPolish(s.plan, s.design, s.doses).descend(s.plan.tuning.dip_weights[0]);
  EXPECT_LT(s.judge.score(1e300).um, before_um);
}

TEST(InhibitedTuning, ReachesTheSolve) {
  // Lags are shares of the kernel's peak; that of the end decides the slices to be shown.
  InhibitedTuning longer;
  for (InhibitedTuning::Fraction& share : longer.lag_shares) share.times *= 4;
  longer.end_lag_share.times *= 4;
  longer.spare_slices += 3;
  const Stages shipped(continuous()), changed(continuous(), false, longer);
  EXPECT_GT(changed.plan.lags.front(), shipped.plan.lags.front());
  EXPECT_GT(changed.plan.end_lag, shipped.plan.end_lag);
  EXPECT_EQ(changed.plan.slices_for(0, 9) - shipped.plan.slices_for(0, 9),
            changed.plan.end_lag - shipped.plan.end_lag + 3);
  EXPECT_EQ(shipped.plan.slices_for(0, 9), slices_with_burst(shipped.model, 0, 9));
}

TEST(InhibitedColumn, AnEmptyColumnStaysBlack) {
  Stages s(continuous());
  InhibitedColumn column(s.plan);
  column.solve({{3, 30, 255}});
  for (const std::uint8_t level : column.solve({})) EXPECT_EQ(level, 0);
}

}  // namespace
}  // namespace slicecorr::detail
