// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Plans of parts against whole corrections of them.
#include "slicecorr/plan.hpp"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <random>

#include "plan/closed.hpp"
#include "plan_parts.hpp"
#include "refusal.hpp"
#include "rounds.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/units.hpp"

namespace slicecorr::test {
namespace {

using testing::HasSubstr;

TEST(Plan, ATwoSliceGapGoesAsFastAsItsClosedForm) {
  const MemorySlices part = comb({{{0, 19}, {22, 41}}, {{0, 41}}}, 42);
  const PrintPlan plan = plan_print(part, setup_of(part), {});
  // Levels miss the closed form's contrast by what a vernier of three slices takes: the answer is a step
  // or two below, never above.
  EXPECT_LE(plan.at.speed_mm_h, 3389.69);
  EXPECT_GE(plan.at.speed_mm_h, 3389.69 / 1.01);
  EXPECT_EQ(plan.limited_by, "contrast");
  EXPECT_EQ(plan.limit_place.first, 20);
  EXPECT_EQ(plan.limit_place.last, 21);
  EXPECT_EQ(plan.limit_place.x, 0);
  EXPECT_EQ(plan.distinct_columns, 2U);
  ASSERT_EQ(plan.ranges.size(), 1U);
  EXPECT_NEAR(plan.ranges[0].greatest_mm_h, 3389.69, 0.005);

  // The whole part's own correction and prediction say the same, and that half a percent more fails.
  slicecorr::Setup at = plan.setup;
  EXPECT_EQ(at.process.speed_mm_h, plan.at.speed_mm_h);
  const Prediction keeps = printed(part, at);
  EXPECT_GE(keeps.gap_contrast.least(), 0.05);
  EXPECT_NEAR(keeps.gap_contrast.least(), plan.at.contrast, 1e-12);
  EXPECT_NEAR(keeps.height_error_um.greatest(), plan.at.max_abs_um, 1e-9);
  EXPECT_NEAR(keeps.height_error_um.mean(), plan.at.mean_abs_um, 1e-5);
  EXPECT_EQ(keeps.layers - part.grid().layers, plan.at.extra_slices);
  ASSERT_TRUE(plan.faster);
  EXPECT_FALSE(plan.faster->keeps);
  at.process.speed_mm_h = plan.faster->speed_mm_h;
  EXPECT_NEAR(at.process.speed_mm_h, 1.005 * plan.at.speed_mm_h, 1e-5 * plan.at.speed_mm_h);
  EXPECT_LT(printed(part, at).gap_contrast.least(), 0.05);

  // Time: slices times height over speed.
  EXPECT_NEAR(plan.at.time_s, keeps.layers * 50 * 3.6 / plan.at.speed_mm_h, 1e-9);
  const auto step = std::find_if(plan.steps.begin(), plan.steps.end(), [](const PlanStep& s) {
    return s.change == "absorbance height 20 % lower";
  });
  ASSERT_NE(step, plan.steps.end());
  EXPECT_NEAR(step->speed_mm_h.value(), 2993.71, 0.005);
}

TEST(Plan, EveryPointIsACorrection) {
  const MemorySlices part = comb({{{0, 9}, {13, 25}}, {{3, 8}, {12, 12}, {20, 25}}}, 26);
  PlanAsk ask;
  ask.curve_points = 6;
  const PrintPlan plan = plan_print(part, setup_of(part), ask);
  ASSERT_GE(plan.curve.size(), 6U);
  double before = 0;
  for (const PlanPoint& p : plan.curve) {
    EXPECT_GT(p.speed_mm_h, before);
    before = p.speed_mm_h;
    slicecorr::Setup at = plan.setup;
    at.process.speed_mm_h = p.speed_mm_h;
    const Prediction whole = printed(part, at);
    EXPECT_NEAR(p.contrast, whole.gap_contrast.least(), 1e-12) << p.speed_mm_h;
    EXPECT_NEAR(p.max_abs_um, whole.height_error_um.greatest(), 1e-9);
    EXPECT_EQ(p.lost, whole.lost_features);
    EXPECT_EQ(p.keeps, whole.gap_contrast.least() >= 0.05 && whole.lost_features == 0 &&
                           whole.split_features == 0 && whole.height_error_um.greatest() <= 25);
  }
}

TEST(Plan, RandomPartsKeepWhatIsAskedForAndNoMore) {
  std::mt19937 random(31);
  int limited = 0;
  for (int round = 0; round < rounds(12); ++round) {
    std::vector<std::vector<std::pair<int, int>>> columns;
    for (int x = 0; x < 6; ++x) {
      std::vector<std::pair<int, int>> runs;
      for (int n = static_cast<int>(random() % 4); n < 40;) {
        const int last = n + 1 + static_cast<int>(random() % 8);
        runs.push_back({n, std::min(last, 44)});
        n = last + 3 + static_cast<int>(random() % 5);
      }
      columns.push_back(runs);
    }
    const MemorySlices part = comb(columns, 45);
    PlanAsk ask;
    ask.curve_points = 0;
    ask.gap_contrast = 0.04;
    ask.least_gap_um = 50;  // that from the platform may have one slice
    PrintPlan plan;
    try {
      plan = plan_print(part, setup_of(part), ask);
    } catch (const InfeasibleError& e) {
      // Only a gap of one slice from the platform can do so.
      EXPECT_THAT(std::string(e.what()), HasSubstr("contrast"));
      continue;
    }
    slicecorr::Setup at = plan.setup;
    const Prediction keeps = printed(part, at);
    EXPECT_GE(keeps.gap_contrast.least(), 0.04 - 1e-9);
    EXPECT_LE(keeps.height_error_um.greatest(), 25);
    EXPECT_EQ(keeps.lost_features + keeps.split_features, 0U);
    if (!plan.faster) continue;
    ++limited;
    at.process.speed_mm_h = plan.faster->speed_mm_h;
    const Prediction fails = printed(part, at);
    EXPECT_TRUE(fails.gap_contrast.least() < 0.04 || fails.height_error_um.greatest() > 25 ||
                fails.lost_features + fails.split_features > 0);
  }
  EXPECT_GT(limited, 3);
}

TEST(Plan, EdgesAimedAtLessFinelyLeaveGapsDarker) {
  const MemorySlices part = comb({{{0, 19}, {22, 41}}}, 42);
  slicecorr::Setup at = setup_of(part);
  int finely = 0;
  for (double speed = 600; speed < 3380; speed *= 1.05) {
    at.process.speed_mm_h = speed;
    at.process.edge_aim_um = 0;
    finely += printed(part, at).gap_contrast.least() >= 0.05;
    at.process.edge_aim_um = 0.5;
    const Prediction p = printed(part, at);
    // All of the closed form's interval, with edges as near as was asked for.
    EXPECT_GE(p.gap_contrast.least(), 0.05) << speed;
    EXPECT_LE(p.height_error_um.greatest(), 0.5 + 1e-6) << speed;
  }
  EXPECT_LT(finely, 30);
  PlanAsk ask;
  ask.curve_points = 0;
  ask.free.edge_aim = true;
  const PrintPlan plan = plan_print(part, setup_of(part), ask);
  EXPECT_GE(plan.at.speed_mm_h, 3389.69 / 1.005);
  EXPECT_EQ(plan.chosen.size(), 4U);
  EXPECT_GE(printed(part, plan.setup).gap_contrast.least(), 0.05);
  // Near the most that the gap can have, only these speeds keep it: they are tried unasked.
  ask.free.edge_aim = false;
  ask.gap_contrast = 0.0546;
  const PrintPlan unasked = plan_print(part, setup_of(part), ask);
  EXPECT_THAT(unasked.with, HasSubstr("edges aimed at"));
  EXPECT_GT(unasked.setup.process.edge_aim_um, 0);
  EXPECT_GE(printed(part, unasked.setup).gap_contrast.least(), 0.0546 - 1e-9);
}

TEST(Plan, AGapOfOneSliceIsLeftOutAndTold) {
  const MemorySlices part = comb({{{0, 19}, {21, 41}}, {{0, 19}, {24, 41}}}, 42);
  const PrintPlan plan = plan_print(part, setup_of(part), {});
  ASSERT_EQ(plan.gaps.size(), 2U);
  EXPECT_EQ(plan.gaps[0].slices, 1);
  EXPECT_TRUE(plan.gaps[0].left_out);
  EXPECT_EQ(plan.gaps[0].place.first, 20);
  EXPECT_EQ(plan.gaps[1].slices, 4);
  EXPECT_FALSE(plan.gaps[1].left_out);
  // Asked for, it can't be had.
  PlanAsk ask;
  ask.least_gap_um = 50;
  try {
    plan_print(part, setup_of(part), ask);
    ADD_FAILURE() << "a gap of one slice has no contrast with both edges right";
  } catch (const InfeasibleError& e) {
    EXPECT_THAT(std::string(e.what()),
                HasSubstr("the gap of 50 um (1 slice) at pixel 0, 0, slices 20 to 20"));
  }
  // What it costs is not counted: the one-slice gap loses its edge, the others don't.
  slicecorr::Setup at = plan.setup;
  EXPECT_GT(printed(part, at).height_error_um.greatest(), plan.at.max_abs_um);
}

TEST(Plan, NothingFeasibleNamesTheNearestContrast) {
  const MemorySlices part = comb({{{0, 19}, {22, 41}}}, 42);
  PlanAsk ask;
  ask.gap_contrast = 0.06;
  const BestGap best = best_gap(kFigure22, 2);
  EXPECT_LT(best.contrast, 0.06);
  try {
    plan_print(part, setup_of(part), ask);
    ADD_FAILURE() << "no speed has this contrast";
  } catch (const InfeasibleError& e) {
    const std::string text = e.what();
    // Whoever types the contrast that is named gets a plan's closed form.
    EXPECT_THAT(text, HasSubstr("at most 0.05486"));
    EXPECT_NEAR(best.contrast, 0.05486, 1e-5);
    EXPECT_THAT(text, HasSubstr("100 um (2 slices) at pixel 0, 0, slices 20 to 21"));
    EXPECT_THAT(text, HasSubstr("at least 150 um"));
  }
  EXPECT_FALSE(gap_speeds(kFigure22, 2, 0.05486).empty());
  ask.gap_contrast = 0.05;
  ask.tolerance_um = 8;  // less than lam times 1 %
  try {
    plan_print(part, setup_of(part), ask);
    ADD_FAILURE() << "no speed has this tolerance";
  } catch (const InfeasibleError& e) {
    EXPECT_THAT(std::string(e.what()), HasSubstr("8.68589 um"));
  }
}

TEST(Plan, AToleranceBelowWhatLevelsDoNamesTheLeast) {
  // Four levels.
  const MemorySlices part = comb({{{5, 19}, {30, 41}}}, 42);
  slicecorr::Setup coarse = setup_of(part);
  coarse.printer.bit_depth = 2;
  coarse.printer.calibration = {{0, 1}, {3, 100}};
  PlanAsk ask;
  ask.light_error = 0;
  ask.tolerance_um = 0.001;
  std::string text;
  try {
    plan_print(part, coarse, ask);
    ADD_FAILURE() << "four levels do not place edges so well";
  } catch (const InfeasibleError& e) {
    text = e.what();
  }
  const std::size_t at = text.find("tolerance of at least ");
  ASSERT_NE(at, std::string::npos) << text;
  ask.tolerance_um = std::stod(text.substr(at + 22));
  EXPECT_GT(ask.tolerance_um, 0.001);
  // What is named works.
  EXPECT_TRUE(plan_print(part, coarse, ask).at.keeps);
}

TEST(Plan, WithoutGapsTheLightsErrorLimits) {
  const MemorySlices block = comb({{{0, 19}}}, 20);
  const PrintPlan plan = plan_print(block, setup_of(block), {});
  EXPECT_EQ(plan.limited_by, "tolerance");
  // P = 1 + lam delta / T.
  const double most = 6250 / (1 + 8.6858896 / 25);
  EXPECT_LE(plan.at.speed_mm_h, most);
  EXPECT_NEAR(plan.at.speed_mm_h, most, 1e-4 * most);
  EXPECT_EQ(plan.at.contrast_at.x, -1);
  EXPECT_FALSE(plan.faster);
  PlanAsk sure;
  sure.light_error = 0;
  sure.curve_points = 0;
  EXPECT_EQ(plan_print(block, setup_of(block), sure).limited_by, "light");
}

TEST(Plan, TheStageAndTheLamp) {
  const MemorySlices part = comb({{{0, 19}, {22, 41}}}, 42);
  slicecorr::Setup slow = setup_of(part);
  slow.printer.max_speed_mm_h = 800;
  PlanAsk ask;
  ask.curve_points = 3;
  ask.gap_contrast = 0.03;
  const PrintPlan stage = plan_print(part, slow, ask);
  EXPECT_LE(stage.at.speed_mm_h, 800);
  if (stage.limited_by == "stage") {
    EXPECT_EQ(stage.at.speed_mm_h, 800);
  }
  // Slower is worse: at 300 mm/h black leaves no contrast of 0.05, which starts at 588.67 mm/h.
  slow.printer.max_speed_mm_h = 300;
  ask.gap_contrast = 0.05;
  EXPECT_THROW(plan_print(part, slow, ask), InfeasibleError);
  ask.free.lamp = true;
  const PrintPlan lamp = plan_print(part, slow, ask);
  EXPECT_EQ(lamp.at.speed_mm_h, 300);
  EXPECT_LT(lamp.lamp_share, 300 / 588.67);
  EXPECT_GT(lamp.lamp_share, 300 / 3389.69 * 0.99);
  EXPECT_EQ(lamp.limited_by, "stage");
  // It does what it says: the same part with that share of the light.
  slicecorr::Setup dim = lamp.setup;
  dim.printer = dimmed(slow.printer, lamp.lamp_share);
  dim.process.speed_mm_h = 300;
  EXPECT_GE(printed(part, dim).gap_contrast.least(), 0.05 - 1e-5);
}

TEST(Plan, LayerByLayerFindsTheLeastExposure) {
  const MemorySlices part = comb({{{0, 9}, {12, 21}}}, 22);
  slicecorr::Setup s = setup_of(part);
  s.resin = resin(576, 110);
  s.process = Process{};
  s.process.mode = ExposureMode::layerwise;
  s.process.exposure_s = 1;
  const PrintPlan plan = plan_print(part, s, {});
  // Full light must leave the critical dose at a layer's far edge: te = 1 / (phi'_max a) at 1 s.
  const CureModel model = make_cure_model(s.printer, s.resin, s.process, 50);
  const double least = 1 / (model.phi_max() * model.a);
  EXPECT_GE(plan.at.exposure_s, least);
  EXPECT_LE(plan.at.exposure_s, least * 1.005);
  EXPECT_EQ(plan.at.speed_mm_h, 0);
  const Prediction keeps = printed(part, plan.setup);
  EXPECT_GE(keeps.gap_contrast.least(), 0.05);
  EXPECT_LE(keeps.height_error_um.greatest(), 25);
  EXPECT_TRUE(plan.ranges.empty());
  // A tolerance that only more light breaks does not change the least exposure; one that the least breaks
  // has no exposure at all: black's cut-through falls with it.
  EXPECT_EQ(nlohmann::json::parse(plan.to_json())["mode"], "layerwise");
}

TEST(Plan, LessUvLightGoesFaster) {
  const MemorySlices part = comb({{{0, 9}, {16, 25}}}, 26);
  slicecorr::Setup s = setup_of(part);
  s.printer.uv = UvLamp{365, false, {{0, 0}, {255, 275}}};
  s.resin = resin(576, 2000);
  s.resin.inhibition = Inhibition{0.8, 90, 1, 0};
  s.process = process(100);
  s.process.uv = {UvKind::constant, 200, 0, {}};
  PlanAsk ask;
  ask.curve_points = 0;
  ask.gap_contrast = 0.02;
  const PrintPlan given = plan_print(part, s, ask);
  EXPECT_TRUE(given.ranges.empty());  // no closed forms under UV light
  ask.free.uv = true;
  const PrintPlan free = plan_print(part, s, ask);
  EXPECT_GE(free.at.speed_mm_h, given.at.speed_mm_h);
  EXPECT_LE(free.setup.process.uv.uv_mw_cm2, 200);
  EXPECT_EQ(free.chosen.size(), 5U);
  const Prediction keeps = printed(part, free.setup);
  EXPECT_GE(keeps.gap_contrast.least(), 0.02 - 1e-9);
  ASSERT_TRUE(keeps.dead_zones);
  EXPECT_EQ(keeps.dead_zones->cured_pixels, 0U);
}

TEST(Plan, UvLightOfSlicesIsThatOfEachSpeed) {
  const MemorySlices part = comb({{{0, 9}, {16, 25}}, {{0, 12}, {20, 25}}, {{14, 25}}}, 26);
  for (const UvKind kind : {UvKind::per_slice, UvKind::patterned}) {
    slicecorr::Setup s = setup_of(part);
    s.printer.uv = UvLamp{365, kind == UvKind::patterned, {{0, 0}, {255, 275}}};
    s.resin = resin(576, 2000);
    s.resin.inhibition = Inhibition{0.8, 90, 1, 0};
    s.process = process(100);
    s.process.uv = {kind, 0, 15, {}};
    PlanAsk ask;
    ask.curve_points = 0;
    ask.gap_contrast = 0.02;
    const PrintPlan plan = plan_print(part, s, ask);
    // UV light is chosen by who corrects at this speed.
    EXPECT_TRUE(plan.setup.process.uv.slice_mw_cm2.empty());
    const auto keeps = [&](double times) {
      slicecorr::Setup with = plan.setup;
      with.process.speed_mm_h *= times;
      with.process = schedule_uv(part, with);
      EXPECT_EQ(with.process.uv.slice_mw_cm2.empty(), kind == UvKind::patterned);
      const Prediction p = printed(part, with);
      EXPECT_EQ(p.dead_zones->cured_pixels, 0U);
      return p.gap_contrast.least() >= 0.02 - 1e-9 && p.lost_features == 0 &&
             p.height_error_um.greatest() <= ask.tolerance_um + 1e-6;
    };
    EXPECT_TRUE(keeps(1)) << static_cast<int>(kind);
    EXPECT_FALSE(keeps(1.02)) << static_cast<int>(kind);
  }
}

TEST(Plan, ManyColumnsAreAnsweredByAFew) {
  // All gaps of 3 to 40 slices at all places: more columns than are looked at.
  std::vector<std::vector<std::pair<int, int>>> columns;
  for (int gap = 3; gap < 41; ++gap) {
    for (int first = 5; first < 25; ++first) columns.push_back({{0, first}, {first + gap + 1, 79}});
  }
  const MemorySlices part = comb(columns, 80);
  PlanAsk ask;
  ask.curve_points = 0;
  const PrintPlan all = plan_print(part, setup_of(part), ask);
  EXPECT_EQ(all.judged_columns, columns.size());
  ask.most_columns = 60;
  const PrintPlan few = plan_print(part, setup_of(part), ask);
  EXPECT_LT(few.judged_columns, columns.size());
  EXPECT_TRUE(few.at.all_columns);
  const Prediction keeps = printed(part, few.setup);
  EXPECT_GE(keeps.gap_contrast.least(), 0.05 - 1e-9);
  // Both found a speed that keeps with the next half percent failing; levels decide which.
  EXPECT_NEAR(few.at.speed_mm_h, all.at.speed_mm_h, 0.05 * all.at.speed_mm_h);
}

TEST(Plan, SameAnswerForAnyNumberOfThreads) {
  const MemorySlices part = comb({{{0, 9}, {13, 25}}, {{3, 8}, {12, 12}, {20, 25}}}, 26);
  ExecutionContext one, two;
  one.threads = 1;
  two.threads = 2;
  EXPECT_EQ(plan_print(part, setup_of(part), {}, one).to_json(),
            plan_print(part, setup_of(part), {}, two).to_json());
}

TEST(Plan, PictureAndJson) {
  const MemorySlices part = comb({{{0, 19}, {23, 41}}}, 42);
  const PrintPlan plan = plan_print(part, setup_of(part), {});
  const auto j = nlohmann::json::parse(plan.to_json());
  EXPECT_EQ(j["speed_mm_h"], plan.at.speed_mm_h);
  EXPECT_EQ(j["limited_by"], "contrast");
  for (const auto& p : j["curve"]) {
    EXPECT_TRUE(p.contains("speed_mm_h") && p.contains("max_abs_um") && p.contains("contrast"));
  }
  const std::string svg = plan.svg("a part");
  EXPECT_THAT(svg, HasSubstr("least contrast of gaps"));
  EXPECT_THAT(svg, HasSubstr("largest edge error"));
}

TEST(Plan, BadInput) {
  const MemorySlices part = comb({{{0, 19}, {23, 41}}}, 42);
  const auto refused = [&](const std::function<void(slicecorr::Setup&, PlanAsk&)>& change) {
    slicecorr::Setup s = setup_of(part);
    PlanAsk ask;
    change(s, ask);
    return refusal([&] { plan_print(part, s, ask); });
  };
  EXPECT_THAT(refused([](slicecorr::Setup&, PlanAsk& a) { a.tolerance_um = 0; }),
              HasSubstr("tolerance"));
  EXPECT_THAT(refused([](slicecorr::Setup&, PlanAsk& a) { a.gap_contrast = 1; }),
              HasSubstr("contrast"));
  EXPECT_THAT(refused([](slicecorr::Setup&, PlanAsk& a) { a.light_error = -0.1; }),
              HasSubstr("error"));
  EXPECT_THAT(refused([](slicecorr::Setup&, PlanAsk& a) { a.free.uv = true; }), HasSubstr("UV"));
  EXPECT_THAT(
      refused([](slicecorr::Setup& s, PlanAsk&) { s.process.even_dead_zone = EvenDeadZone::blue; }),
      HasSubstr("even dead zone"));
  const MemorySlices empty = comb({{}}, 5);
  EXPECT_THAT(refusal([&] { plan_print(empty, setup_of(empty), {}); }),
              HasSubstr("nothing would print"));
}

}  // namespace
}  // namespace slicecorr::test
