/// Closed forms of planning against direct sums and scans, and plans of parts against whole
/// corrections of them.
#include "slicecorr/plan.hpp"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>
#include <random>
#include <set>

#include "memory_slices.hpp"
#include "models.hpp"
#include "plan/closed.hpp"
#include "plan/design_columns.hpp"
#include "plan/search.hpp"
#include "refusal.hpp"
#include "rounds.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/units.hpp"

namespace slicecorr::test {
namespace {

using testing::HasSubstr;

/// Figure 2.2.
const PlanLight kF = plan_light(figure_2_2(), 1000);

/// The least dose in a gap of g slices whose upper end must have the dose 1 again, by going through it
/// slice by slice with the least light after which full light can still make the climb.
double darkest(const PlanLight& light, int slices, double speed_mm_h) {
  const double a = light.a(), full = light.full(speed_mm_h), black = light.black(speed_mm_h);
  double dose = 1, least = 1;
  for (int left = slices; left-- > 0;) {
    // Undone: what the dose must be before `left` slices of full light end at 1.
    double needed = 1;
    for (int k = 0; k < left; ++k) needed = (needed - full * (1 - a)) / a;
    const double dark = black * (1 - a) + a * dose;
    dose = std::max(dark, needed);
    if (dose > full * (1 - a) + a * dose + 1 || dose < 0) return 1;
    least = std::min(least, dose);
  }
  return least;
}

bool in_ranges(const std::vector<SpeedRange>& ranges, double speed) {
  return std::any_of(ranges.begin(), ranges.end(), [&](const SpeedRange& r) {
    return r.least_mm_h <= speed && speed <= r.greatest_mm_h;
  });
}

TEST(PlanGapLight, FigureTwoTwoHasTheSpeedsOfItsCheckValues) {
  EXPECT_NEAR(kF.smax_mm_h, 6250, 1e-9);
  EXPECT_NEAR(kF.smin_mm_h, 62.5, 1e-11);
  EXPECT_NEAR(kF.lam_um, 868.58896, 1e-5);
  const auto two = gap_speeds(kF, 2, 0.05);
  ASSERT_EQ(two.size(), 1U);
  EXPECT_NEAR(two[0].least_mm_h, 588.67, 0.005);
  EXPECT_NEAR(two[0].greatest_mm_h, 3389.69, 0.005);
  const auto three = gap_speeds(kF, 3, 0.05);
  ASSERT_EQ(three.size(), 1U);
  EXPECT_NEAR(three[0].least_mm_h, 115.69, 0.005);
  EXPECT_NEAR(three[0].greatest_mm_h, 4433.33, 0.005);
  // With a hole.
  const auto hole = gap_speeds(kF, 3, 0.055);
  ASSERT_EQ(hole.size(), 2U);
  EXPECT_NEAR(hole[0].least_mm_h, 126.45, 0.005);
  EXPECT_NEAR(hole[0].greatest_mm_h, 3241.35, 0.005);
  EXPECT_NEAR(hole[1].least_mm_h, 3722.83, 0.005);
  EXPECT_NEAR(hole[1].greatest_mm_h, 4308.11, 0.005);
  const auto any = gap_speeds_um(kF, 100, 0.05);
  ASSERT_TRUE(any);
  EXPECT_NEAR(any->least_mm_h, 116.47, 0.005);
  EXPECT_NEAR(any->greatest_mm_h, 3530.40, 0.005);
  // Both ends together (§3).
  EXPECT_NEAR(any->least_mm_h * any->greatest_mm_h, kF.smin_mm_h * kF.smax_mm_h / 0.95, 1e-6);
  const BestGap best = best_gap_um(kF, 100);
  EXPECT_NEAR(best.speed_mm_h, 655.14, 0.005);
  EXPECT_NEAR(best.contrast, 0.08988, 1e-5);
  // Absorbance height 20 % lower, areal dose as it is.
  PlanLight lower = kF;
  lower.smax_mm_h *= 0.8;
  lower.smin_mm_h *= 0.8;
  lower.lam_um *= 0.8;
  const auto step = gap_speeds(lower, 2, 0.05);
  ASSERT_EQ(step.size(), 1U);
  EXPECT_NEAR(step[0].least_mm_h, 178.68, 0.005);
  EXPECT_NEAR(step[0].greatest_mm_h, 2993.71, 0.005);
}

TEST(PlanGapLight, ContrastIsThatOfTheDarkestSlicesThatStillClimb) {
  std::mt19937 random(29);
  std::uniform_real_distribution<double> share(0, 1);
  for (int round = 0; round < rounds(400); ++round) {
    PlanLight light;
    light.smax_mm_h = 1000 * (1 + 20 * share(random));
    light.smin_mm_h = light.smax_mm_h * std::pow(10, -3 + 2.5 * share(random));
    light.layer_um = 20 + 80 * share(random);
    light.lam_um = 100 + 900 * share(random);
    const int slices = 2 + static_cast<int>(8 * share(random));
    for (const double at : {0.05, 0.2, 0.5, 0.8, 0.95}) {
      const double speed = light.smin_mm_h * std::pow(light.smax_mm_h / light.smin_mm_h, at);
      const double contrast = gap_contrast(light, slices, speed);
      // Rounding of some ten operations on doses that are undone by a^-9, at most e^9.
      EXPECT_NEAR(contrast, 1 - darkest(light, slices, speed), 1e-11)
          << slices << " slices at " << speed;
    }
  }
}

TEST(PlanGapLight, RangesAreWhereAScanFindsTheContrast) {
  std::mt19937 random(30);
  std::uniform_real_distribution<double> share(0, 1);
  int holes = 0;
  for (int round = 0; round < rounds(60); ++round) {
    PlanLight light = kF;
    light.smin_mm_h = light.smax_mm_h * std::pow(10, -3 + 2 * share(random));
    light.lam_um = 200 + 900 * share(random);
    const int slices = 2 + static_cast<int>(6 * share(random));
    const double contrast = 0.7 * best_gap(light, slices).contrast + 0.5 * 1e-3 * share(random);
    const auto ranges = gap_speeds(light, slices, contrast);
    holes += ranges.size() > 1;
    constexpr int kScan = 2000;
    for (int k = 1; k < kScan; ++k) {
      const double speed =
          light.smin_mm_h * std::pow(light.smax_mm_h / light.smin_mm_h, double(k) / kScan);
      const double scanned = gap_contrast(light, slices, speed);
      if (std::abs(scanned - contrast) < 1e-9) continue;
      ASSERT_EQ(in_ranges(ranges, speed), scanned > contrast) << slices << " " << speed;
    }
    // No speed of the scan is better than the best.
    const BestGap best = best_gap(light, slices);
    EXPECT_NEAR(gap_contrast(light, slices, best.speed_mm_h), best.contrast, 1e-12);
    for (int k = 1; k < kScan; ++k) {
      const double speed =
          light.smin_mm_h * std::pow(light.smax_mm_h / light.smin_mm_h, double(k) / kScan);
      ASSERT_LE(gap_contrast(light, slices, speed), best.contrast + 1e-12);
    }
  }
  EXPECT_GT(holes, 0);
}

TEST(PlanGapLight, SlicesOfNoHeightComeToTheContinuousBound) {
  for (const double gap_um : {60.0, 100.0, 400.0}) {
    PlanLight fine = kF;
    constexpr int kSlices = 4000;
    fine.layer_um = gap_um / kSlices;
    const BestGap whole = best_gap(fine, kSlices), bound = best_gap_um(kF, gap_um);
    // Where dark and lit meet is off by half a slice: 1/8000 of the contrast, which is flat there.
    EXPECT_LE(whole.contrast, bound.contrast);
    EXPECT_NEAR(whole.contrast, bound.contrast, 1e-3 * bound.contrast);
    const double contrast = 0.6 * bound.contrast;
    const auto ranges = gap_speeds(fine, kSlices, contrast);
    const auto any = gap_speeds_um(kF, gap_um, contrast);
    ASSERT_EQ(ranges.size(), 1U);
    ASSERT_TRUE(any);
    EXPECT_NEAR(ranges[0].least_mm_h, any->least_mm_h, 2e-3 * any->least_mm_h);
    EXPECT_NEAR(ranges[0].greatest_mm_h, any->greatest_mm_h, 2e-3 * any->greatest_mm_h);
    EXPECT_FALSE(gap_speeds_um(kF, gap_um, bound.contrast * 1.001));
    EXPECT_TRUE(gap_speeds_um(kF, gap_um, bound.contrast * 0.999));
  }
}

TEST(PlanGapLight, TheDissertationsSetsHaveTheirGapsOfTwoSlices) {
  struct Set {
    double ha_um, dc, most_mw_cm2, speed, full, black, smax, least, greatest;
  };
  const Set sets[] = {{2000, 576, 100, 1000, 6.2500, 0.06250, 6250, 588.7, 3389.7},
                      {1500, 230, 100, 800, 19.565, 0.19565, 15652, 484.2, 9621.7},
                      {2000, 173, 100, 800, 26.012, 0.26012, 20809, 1960, 11286},
                      {2000, 748, 75, 750, 4.8128, 0.06417, 3609.6, 453.3, 1957.7}};
  for (const Set& s : sets) {
    const CureModel model = make_cure_model(linear_printer(1, s.most_mw_cm2), resin(s.dc, s.ha_um),
                                            process(s.speed), 50);
    const PlanLight light = plan_light(model, s.speed);
    // To the digits of the table.
    EXPECT_NEAR(light.full(s.speed), s.full, 1e-4 * s.full);
    EXPECT_NEAR(light.black(s.speed), s.black, 1e-4 * s.black);
    EXPECT_NEAR(light.smax_mm_h, s.smax, 1e-4 * s.smax);
    const auto ranges = gap_speeds(light, 2, 0.05);
    ASSERT_EQ(ranges.size(), 1U);
    EXPECT_NEAR(ranges[0].least_mm_h, s.least, 2e-4 * s.least);
    EXPECT_NEAR(ranges[0].greatest_mm_h, s.greatest, 2e-4 * s.greatest);
    // The same by a scan of the darkest slices.
    for (const double factor : {0.999, 1.001}) {
      EXPECT_EQ(1 - darkest(light, 2, ranges[0].greatest_mm_h * factor) >= 0.05, factor < 1);
      EXPECT_EQ(1 - darkest(light, 2, ranges[0].least_mm_h * factor) >= 0.05, factor > 1);
    }
  }
}

TEST(PlanGapLight, EdgesMoveByTheToleranceAtTheEnds) {
  const auto r = tolerated_speeds(kF, 25, 0.01);
  ASSERT_TRUE(r);
  // The dose near an upper edge decays to black, near a lower one it rises to full light: derivatives
  // by differences of where the doses are 1.
  const auto upper = [&](double light) {
    // Dose of a stretch that was 1 at its end under the light 1, in black light after it.
    const double p0 = kF.black(r->least_mm_h) * light;
    return kF.lam_um * std::log((light - p0) / (1 - p0));
  };
  const auto lower = [&](double light) {
    const double p = kF.full(r->greatest_mm_h);
    const double burst = -std::log1p(-1 / p);  // over lam
    return kF.lam_um * (burst + std::log1p(-1 / (p * light)));
  };
  constexpr double kStep = 1e-5;
  EXPECT_NEAR((upper(1 + kStep) - upper(1 - kStep)) / (2 * kStep) * 0.01, 25, 1e-3);
  EXPECT_NEAR((lower(1 + kStep) - lower(1 - kStep)) / (2 * kStep) * 0.01, 25, 1e-3);
  EXPECT_FALSE(tolerated_speeds(kF, kF.lam_um * 0.01, 0.01));
  EXPECT_EQ(tolerated_speeds(kF, 25, 0)->greatest_mm_h, kF.smax_mm_h);
}

TEST(PlanGapLight, RangesMeet) {
  const std::vector<SpeedRange> a{{1, 3}, {5, 9}}, b{{2, 6}, {8, 20}};
  EXPECT_EQ(common(a, b), (std::vector<SpeedRange>{{2, 3}, {5, 6}, {8, 9}}));
  EXPECT_TRUE(common(a, {}).empty());
}

TEST(PlanSearch, FindsTheGreatestPaceOfRangesWithHoles) {
  const auto search = [](const std::vector<SpeedRange>& keeps, double most) {
    std::set<double> tried;
    const auto found = detail::fastest_pace({{1, 100}}, most, [&](double p) {
      tried.insert(p);
      return in_ranges(keeps, p);
    });
    if (found) {
      EXPECT_TRUE(in_ranges(keeps, *found));
      EXPECT_TRUE(tried.contains(*found));
      EXPECT_TRUE(tried.contains(*found * detail::kPaceStep) || *found * detail::kPaceStep > most);
      EXPECT_FALSE(in_ranges(keeps, *found * detail::kPaceStep) &&
                   *found * detail::kPaceStep <= most);
      EXPECT_LE(tried.size(), 40U);
    }
    return found;
  };
  for (const double top : {1.5, 7.3, 40.0, 99.9, 130.0, 550.0}) {
    const auto found = search({{1, top}}, 1000);
    ASSERT_TRUE(found) << top;
    EXPECT_LE(*found, top);
    EXPECT_GE(*found * detail::kPaceStep, top);
  }
  EXPECT_EQ(search({{1, 5000}}, 1000), 1000);
  EXPECT_FALSE(search({{2000, 5000}}, 1000));
  // Holes: the upper stretch is found.
  const auto holes = search({{1, 30}, {60, 80}}, 1000);
  ASSERT_TRUE(holes);
  EXPECT_GT(*holes, 79);
}

// ------------------------------------------------------------------------- parts

/// Columns of runs [first, last], one a pixel of a row, full from the platform.
MemorySlices comb(const std::vector<std::vector<std::pair<int, int>>>& columns, int layers) {
  MemorySlices part({static_cast<int>(columns.size()), 1, layers, 50, 50, 50});
  for (std::size_t x = 0; x < columns.size(); ++x) {
    for (const auto& [first, last] : columns[x]) {
      for (int n = first; n <= last; ++n) part.at(n, static_cast<int>(x), 0) = 255;
    }
  }
  return part;
}

Setup setup_of(const SliceSource& part) {
  slicecorr::Setup s;
  s.printer = linear_printer(1, 100);
  s.printer.width_px = part.grid().width_px;
  s.printer.height_px = part.grid().height_px;
  s.resin = resin(576, 2000);
  s.process = process(1);
  return s;
}

/// What the whole correction of a part prints.
Prediction printed(const SliceSource& part, const Setup& setup) {
  const CorrectedSlices corrected(part, setup);
  return verify_stack(corrected, part, setup);
}

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
  const BestGap best = best_gap(kF, 2);
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
  EXPECT_FALSE(gap_speeds(kF, 2, 0.05486).empty());
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
