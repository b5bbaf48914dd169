// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Closed forms of planning against direct sums and scans, and the search for the greatest pace.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <optional>
#include <random>
#include <set>

#include "plan/search.hpp"
#include "plan_parts.hpp"
#include "rounds.hpp"
#include "slicecorr/plan.hpp"
#include "slicecorr/units.hpp"

namespace slicecorr::test {
namespace {

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

/// The speed with the greatest contrast of a height of any size, slices of no height: what no slicing gets beyond.
BestGap best_gap_um(const PlanLight& light, double gap_um) {
  const double g = std::exp(gap_um / light.lam_um), r = light.smin_mm_h / light.smax_mm_h;
  // x^2 is the least dose in the gap at best; r 0 leaves no least speed.
  const double root = std::sqrt(r);
  const double x = ((g - 1) * root + std::sqrt(g) * (1 - r)) / (g - r);
  return {light.smax_mm_h * root / x, 1 - x * x};
}

/// Speeds at which it is at least `contrast`.
std::optional<SpeedRange> gap_speeds_um(const PlanLight& light, double gap_um, double contrast) {
  const double g = std::exp(gap_um / light.lam_um), r = light.smin_mm_h / light.smax_mm_h;
  const double m = 1 - contrast;
  // r P^2 - P b + m = 0; its roots are the ends in P.
  const double b = (g * (m + r) - 1 - r * m) / (g - 1);
  const double below_root = b * b - 4 * r * m;
  if (!(b > 0) || below_root < 0) return std::nullopt;
  const double q = (b + std::sqrt(below_root)) / 2;
  const double least_p = m / q;
  if (!(least_p > 1)) return std::nullopt;
  return SpeedRange{r > 0 ? light.smax_mm_h * r / q : 0.0, light.smax_mm_h / least_p};
}

TEST(PlanGapLight, FigureTwoTwoHasTheSpeedsOfItsCheckValues) {
  EXPECT_NEAR(kFigure22.smax_mm_h, 6250, 1e-9);
  EXPECT_NEAR(kFigure22.smin_mm_h, 62.5, 1e-11);
  EXPECT_NEAR(kFigure22.lam_um, 868.58896, 1e-5);
  const auto two = gap_speeds(kFigure22, 2, 0.05);
  ASSERT_EQ(two.size(), 1U);
  EXPECT_NEAR(two[0].least_mm_h, 588.67, 0.005);
  EXPECT_NEAR(two[0].greatest_mm_h, 3389.69, 0.005);
  const auto three = gap_speeds(kFigure22, 3, 0.05);
  ASSERT_EQ(three.size(), 1U);
  EXPECT_NEAR(three[0].least_mm_h, 115.69, 0.005);
  EXPECT_NEAR(three[0].greatest_mm_h, 4433.33, 0.005);
  // With a hole.
  const auto hole = gap_speeds(kFigure22, 3, 0.055);
  ASSERT_EQ(hole.size(), 2U);
  EXPECT_NEAR(hole[0].least_mm_h, 126.45, 0.005);
  EXPECT_NEAR(hole[0].greatest_mm_h, 3241.35, 0.005);
  EXPECT_NEAR(hole[1].least_mm_h, 3722.83, 0.005);
  EXPECT_NEAR(hole[1].greatest_mm_h, 4308.11, 0.005);
  const auto any = gap_speeds_um(kFigure22, 100, 0.05);
  ASSERT_TRUE(any);
  EXPECT_NEAR(any->least_mm_h, 116.47, 0.005);
  EXPECT_NEAR(any->greatest_mm_h, 3530.40, 0.005);
  // Both ends together (§3).
  EXPECT_NEAR(any->least_mm_h * any->greatest_mm_h,
              kFigure22.smin_mm_h * kFigure22.smax_mm_h / 0.95, 1e-6);
  const BestGap best = best_gap_um(kFigure22, 100);
  EXPECT_NEAR(best.speed_mm_h, 655.14, 0.005);
  EXPECT_NEAR(best.contrast, 0.08988, 1e-5);
  // Absorbance height 20 % lower, areal dose as it is.
  PlanLight lower = kFigure22;
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
    PlanLight light = kFigure22;
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
    PlanLight fine = kFigure22;
    constexpr int kSlices = 4000;
    fine.layer_um = gap_um / kSlices;
    const BestGap whole = best_gap(fine, kSlices), bound = best_gap_um(kFigure22, gap_um);
    // Where dark and lit meet is off by half a slice: 1/8000 of the contrast, which is flat there.
    EXPECT_LE(whole.contrast, bound.contrast);
    EXPECT_NEAR(whole.contrast, bound.contrast, 1e-3 * bound.contrast);
    const double contrast = 0.6 * bound.contrast;
    const auto ranges = gap_speeds(fine, kSlices, contrast);
    const auto any = gap_speeds_um(kFigure22, gap_um, contrast);
    ASSERT_EQ(ranges.size(), 1U);
    ASSERT_TRUE(any);
    EXPECT_NEAR(ranges[0].least_mm_h, any->least_mm_h, 2e-3 * any->least_mm_h);
    EXPECT_NEAR(ranges[0].greatest_mm_h, any->greatest_mm_h, 2e-3 * any->greatest_mm_h);
    EXPECT_FALSE(gap_speeds_um(kFigure22, gap_um, bound.contrast * 1.001));
    EXPECT_TRUE(gap_speeds_um(kFigure22, gap_um, bound.contrast * 0.999));
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
  const auto r = tolerated_speeds(kFigure22, 25, 0.01);
  ASSERT_TRUE(r);
  // The dose near an upper edge decays to black, near a lower one it rises to full light: derivatives
  // by differences of where the doses are 1.
  const auto upper = [&](double light) {
    // Dose of a stretch that was 1 at its end under the light 1, in black light after it.
    const double p0 = kFigure22.black(r->least_mm_h) * light;
    return kFigure22.lam_um * std::log((light - p0) / (1 - p0));
  };
  const auto lower = [&](double light) {
    const double p = kFigure22.full(r->greatest_mm_h);
    const double burst = -std::log1p(-1 / p);  // over lam
    return kFigure22.lam_um * (burst + std::log1p(-1 / (p * light)));
  };
  constexpr double kStep = 1e-5;
  EXPECT_NEAR((upper(1 + kStep) - upper(1 - kStep)) / (2 * kStep) * 0.01, 25, 1e-3);
  EXPECT_NEAR((lower(1 + kStep) - lower(1 - kStep)) / (2 * kStep) * 0.01, 25, 1e-3);
  EXPECT_FALSE(tolerated_speeds(kFigure22, kFigure22.lam_um * 0.01, 0.01));
  EXPECT_EQ(tolerated_speeds(kFigure22, 25, 0)->greatest_mm_h, kFigure22.smax_mm_h);
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

}  // namespace
}  // namespace slicecorr::test
