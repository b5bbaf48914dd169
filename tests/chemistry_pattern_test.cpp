// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Patterns: against figures worked out independently, CVODE, the linear theory, and what must always hold.
#include "slicecorr/chemistry_pattern.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numeric>

#include "chemistries.hpp"
#include "chemistry/diffusion.hpp"
#include "chemistry/light.hpp"
#include "cvode_peer.hpp"
#include "refusal.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/process.hpp"

namespace slicecorr {
namespace {

using test::CvodePeer;
using test::diacrylate;
using test::hydrogel;
using ::testing::HasSubstr;

LightPattern dark(int width, int height) {
  return {width, height, std::vector<float>(static_cast<std::size_t>(width * height), 0.0F)};
}
void light_box(LightPattern& p, int x0, int y0, int w, int h) {
  for (int y = y0; y < y0 + h; ++y) {
    for (int x = x0; x < x0 + w; ++x) p.share[static_cast<std::size_t>(y * p.width + x)] = 1;
  }
}

/// Four columns of 400 um with stripes of 0, 10, 20 and 40 um to 50, and squares of 30, 50 and 100 um in fields of
/// 400 x 300 um, 20 um dark round each; cells of 5 um.
LightPattern stand_in_mask() {
  LightPattern p = dark(320, 180);
  const int stripe[] = {0, 2, 4, 8}, side[] = {6, 10, 20};
  for (int y = 0; y < p.height; ++y) {
    for (int x = 0; x < p.width; ++x) {
      const int s = side[y / 60], fx = x % 80 - (40 - s / 2), fy = y % 60 - (30 - s / 2);
      const auto within = [&](int by) {
        return fx >= -by && fx < s + by && fy >= -by && fy < s + by;
      };
      const bool lit = within(0) || (!within(4) && x % 80 % 10 < stripe[x / 80]);
      p.share[static_cast<std::size_t>(y * p.width + x)] = lit ? 1 : 0;
    }
  }
  return p;
}

PatternSetup setup_of(double cell_um, double intensity, double seconds, double step_s = 0) {
  PatternSetup s;
  s.cell_um = cell_um;
  s.intensity_mw_cm2 = intensity;
  s.light_s = seconds;
  s.step_s = step_s;
  return s;
}

// --- diffusion ---

TEST(ChemistryDiffusion, WavesFallOffAsTheyShould) {
  constexpr int n = 64;
  for (const double tau : {0.01, 0.06, 0.125, 0.25}) {
    const std::vector<double> k = detail::exchange_shares(tau);
    EXPECT_LE(k.size(), 8U);
    for (const int wave : {1, 4, 8}) {
      const double theta = 2 * 3.14159265358979323846 * wave / n;
      double factor = 1;
      for (std::size_t j = 0; j < k.size(); ++j) {
        factor += 2 * k[j] * (std::cos(static_cast<double>(j + 1) * theta) - 1);
      }
      // The differences are theta² up to theta⁶/90, and the shares are cut at 1e-8.
      EXPECT_NEAR(factor, std::exp(-tau * theta * theta), tau * std::pow(theta, 6) / 89 + 1e-7);
    }
  }
}

TEST(ChemistryDiffusion, KeepsAllAndNothingGetsBelow0) {
  const std::vector<double> k = detail::exchange_shares(0.11);
  constexpr std::size_t n = 50;
  for (const bool walls : {false, true}) {
    std::vector<double> a(n, 0.0), b(n);
    std::fill(a.begin() + 10, a.begin() + 17, 1.0);
    a[40] = 1e-3;
    const double all = std::accumulate(a.begin(), a.end(), 0.0);
    for (int step = 0; step < 2000; ++step) {
      std::vector<double> line(n + 2 * k.size());
      for (std::size_t i = 0; i < line.size(); ++i) {
        line[i] = a[detail::wrapped_cell(
            static_cast<std::ptrdiff_t>(i) - static_cast<std::ptrdiff_t>(k.size()), n, walls)];
      }
      std::vector<const double*> before, after;
      for (std::size_t j = 1; j <= k.size(); ++j) {
        before.push_back(line.data() + k.size() - j);
        after.push_back(line.data() + k.size() + j);
      }
      detail::exchange(b.data(), line.data() + k.size(), before.data(), after.data(), k, n);
      a = b;
      ASSERT_GE(*std::min_element(a.begin(), a.end()), 0) << step;
    }
    EXPECT_NEAR(std::accumulate(a.begin(), a.end(), 0.0) / all, 1, 1e-12);
  }
}

// --- light ---

TEST(ChemistryLight, SpreadsAsMuchAsItIs) {
  LightPattern p = dark(40, 30);
  light_box(p, 0, 0, 3, 2);
  for (const Sides sides : {Sides::periodic, Sides::walls}) {
    PatternSetup s = setup_of(5, 100, 1);
    s.spread_um = 8;
    s.sides = sides;
    s.film_um = 170;
    const std::vector<float> light = detail::light_of(hydrogel(), p, s, {});
    const double sum = std::accumulate(light.begin(), light.end(), 0.0);
    EXPECT_NEAR(sum / (6 * 100 * mean_light_share(hydrogel(), 170)), 1, 1e-6);
    EXPECT_GE(*std::min_element(light.begin(), light.end()), 0);
    // Round the corner, or mirrored at it.
    EXPECT_EQ(light[39] > 1, sides == Sides::periodic);
  }
}

// --- all of it ---

TEST(ChemistryPattern, EvenLightIsOneCell) {
  LightPattern p = dark(5, 3);
  light_box(p, 0, 0, 5, 3);
  const PatternRun run = run_pattern(hydrogel(), p, setup_of(5, 100, 2, 0.01));
  for (const double t : run.gel_time_s) EXPECT_NEAR(t, 1.67257, 0.001);
  EXPECT_LT(run.balance_error, 1e-10);
  EXPECT_EQ(run.steps, 200U);
}

TEST(ChemistryPattern, OxygenOfALoneSquareAsInTheLinearTheory) {
  // A square of 50 um at 1.0 s, before anything is used up; the period is 640 um.
  LightPattern p = dark(256, 256);
  light_box(p, 118, 118, 20, 20);
  const PatternRun run = run_pattern(hydrogel(), p, setup_of(2.5, 100, 1.0, 0.005));
  const double left =
      static_cast<double>(run.oxygen_left[127 * 256 + 127]) * hydrogel().oxygen_mol_l;
  // The cell lies half a cell from the centre, where it is 0.093422e-3; on this grid 0.0937e-3 was found.
  EXPECT_NEAR(left, 0.0936e-3, 3e-7);
  EXPECT_LT(run.oxygen_balance_error, 1e-10);
}

TEST(ChemistryPattern, ALineAgreesWithCvode) {
  LightPattern p = dark(128, 1);
  light_box(p, 54, 0, 20, 1);
  std::vector<double> intensity(p.share.begin(), p.share.end());
  for (double& i : intensity) i *= 100;
  CvodePeer peer(hydrogel(), intensity, 2.5, 0, 1e-7);
  const double known = peer.gel_time(63, 3);
  EXPECT_NEAR(known, 1.975, 1e-3);  // worked out to a millisecond by another solver
  double last = 0;
  for (const double step : {0.005, 0.0025}) {
    PatternSetup s = setup_of(2.5, 100, 2.2, step);
    s.sides = Sides::walls;
    const PatternRun run = run_pattern(hydrogel(), p, s);
    last = run.gel_time_at(63, 0);
    EXPECT_NEAR(last / known, 1, 1e-3) << step;
    EXPECT_NEAR(run.gel_time_at(64, 0), last, 1e-9);
    EXPECT_LT(run.balance_error, 1e-10);
    EXPECT_LT(run.oxygen_balance_error, 1e-10);
  }
}

TEST(ChemistryPattern, TheStandInMaskGelsAsWorkedOut) {
  const LightPattern mask = stand_in_mask();
  const auto check = [&](const Chemistry& c, double step_s, double spread_um, double end_s,
                         const double(&known)[3][4]) {
    PatternSetup s = setup_of(5, 100, end_s, step_s);
    s.spread_um = spread_um;
    const PatternRun run = run_pattern(c, mask, s);
    for (int row = 0; row < 3; ++row) {
      for (int column = 0; column < 4; ++column) {
        if (known[row][column] > 0.99 * end_s) continue;
        EXPECT_NEAR(run.gel_time_at(column * 80 + 40, row * 60 + 30) / known[row][column], 1, 0.02)
            << row << " " << column;
      }
    }
    EXPECT_LT(run.balance_error, 1e-10);
    EXPECT_LT(run.oxygen_balance_error, 1e-10);
    return run;
  };
  // All but the loneliest squares, which take many times as long: those are for the night.
  const double h[3][4] = {
      {16.16, 4.498, 3.529, 2.846}, {2.678, 2.436, 2.345, 2.232}, {1.708, 1.707, 1.707, 1.704}};
  check(hydrogel(), 0.01, 0, 5, h);
  const double spread[3][4] = {
      {19.90, 4.913, 3.756, 2.967}, {3.021, 2.630, 2.492, 2.329}, {1.722, 1.722, 1.721, 1.717}};
  const PatternRun run = check(hydrogel(), 0.02, 8, 5.2, spread);
  const double p[3][4] = {
      {9.436, 9.422, 9.413, 9.381}, {7.514, 7.514, 7.514, 7.514}, {7.372, 7.372, 7.372, 7.372}};
  check(diacrylate(), 0.04, 0, 10, p);
  // With spread the dense column runs together while the sparse one is still inhibited.
  int dark_80 = 0, dark_80_gelled = 0, lit_20 = 0, lit_20_gelled = 0;
  for (int y = 0; y < 180; ++y) {
    for (int x = 0; x < 320; ++x) {
      const bool lit = mask.at(x, y) > 0.5F, gelled = run.gel_time_at(x, y) <= 3;
      if (x / 80 == 3 && !lit) {
        ++dark_80;
        dark_80_gelled += gelled;
      }
      if (x / 80 == 1 && lit) {
        ++lit_20;
        lit_20_gelled += gelled;
      }
    }
  }
  EXPECT_NEAR(static_cast<double>(dark_80_gelled) / dark_80, 0.69, 0.02);
  EXPECT_NEAR(static_cast<double>(lit_20_gelled) / lit_20, 0.08, 0.02);
}

TEST(ChemistryPatternNight, TheLoneliestSquares) {
  const LightPattern mask = stand_in_mask();
  const PatternRun run = run_pattern(hydrogel(), mask, setup_of(5, 100, 17, 0.01));
  EXPECT_NEAR(run.gel_time_at(40, 30) / 16.16, 1, 0.02);
  PatternSetup s = setup_of(5, 100, 21, 0.02);
  s.spread_um = 8;
  const PatternRun spread = run_pattern(hydrogel(), mask, s);
  EXPECT_NEAR(spread.gel_time_at(40, 30) / 19.90, 1, 0.02);
  EXPECT_LT(spread.balance_error, 1e-10);
}

TEST(ChemistryPattern, ConvergesWithTheStep) {
  LightPattern p = dark(32, 32);
  light_box(p, 12, 12, 8, 8);
  const auto oxygen = [&](double step_s) {
    return static_cast<double>(
        run_pattern(hydrogel(), p, setup_of(5, 100, 0.8, step_s)).oxygen_left[15 * 32 + 15]);
  };
  // While nobody runs out the error of Strang's splitting is of second order.
  const double exact = oxygen(0.00125);
  const double coarse = std::abs(oxygen(0.02) - exact), fine = std::abs(oxygen(0.005) - exact);
  EXPECT_LT(coarse, 2e-3);
  EXPECT_LT(fine, coarse / 8 + 2e-7);
}

TEST(ChemistryPattern, ReactionsAreOfSecondOrder) {
  const LightPattern p{1, 1, {1.0F}};
  const auto gel = [&](double step_s) {
    return run_pattern(hydrogel(), p, setup_of(5, 100, 1.76, step_s)).gel_time_s[0];
  };
  // Half a step leaves a quarter of the error, also across the end of inhibition.
  const double exact = gel(0.00025), coarse = gel(0.004) - exact, fine = gel(0.002) - exact;
  EXPECT_NEAR(coarse / fine, 4, 0.6);
  EXPECT_LT(std::abs(coarse), 3e-5);
}

TEST(ChemistryPattern, SameForAnyNumberOfThreads) {
  // Large enough to be shared among threads.
  LightPattern p = dark(110, 87);
  light_box(p, 10, 9, 81, 53);
  PatternSetup s = setup_of(5, 300, 0.9);
  s.spread_um = 6;
  s.dark_s = 0.3;
  ExecutionContext one, three;
  one.threads = 1;
  three.threads = 3;
  for (const Sides sides : {Sides::periodic, Sides::walls}) {
    s.sides = sides;
    const PatternRun a = run_pattern(hydrogel(), p, s, one),
                     b = run_pattern(hydrogel(), p, s, three);
    EXPECT_EQ(a.gel_time_s, b.gel_time_s);
    EXPECT_EQ(a.oxygen_left, b.oxygen_left);
    EXPECT_GT(figures_of(a, p).gelled, 0U);
  }
}

TEST(ChemistryPattern, InhibitorAndOxygenFromOutsideDelay) {
  LightPattern p = dark(8, 8);
  light_box(p, 0, 0, 8, 8);
  Chemistry c = hydrogel();
  c.inhibitor_mol_l = 1e-3;
  c.inhibitor_l_mol_s = c.oxygen_l_mol_s;
  c.inhibitor_um2_s = 100;
  EXPECT_NEAR(run_pattern(c, p, setup_of(5, 100, 7)).gel_time_s[0] / 6.26726, 1, 2e-3);
  PatternSetup s = setup_of(5, 100, 4);
  s.supply_per_s = 0.5;
  const double late = run_pattern(hydrogel(), p, s).gel_time_s[0];
  EXPECT_GT(late, inhibition_time_supplied_s(hydrogel(), 100, 0.5));
}

TEST(ChemistryPattern, ABleachingFilmLosesInitiatorByTheClosedForm) {
  // What a film takes up is 1 - exp(-x), x = eps I L, however it lies in it: e^x - 1 falls as exp(-kd t).
  Chemistry c = hydrogel();
  c.oxygen_mol_l = 1;  // enough for all radicals, and so their count: oxygen that is gone
  const LightPattern p{1, 1, {1.0F}};
  PatternSetup s = setup_of(5, 1e6, 0.3, 1e-4);
  s.film_um = 3 * light_height_um(c);
  const double kd = initiation_per_s(c, 1e6);
  const auto initiator_left = [&] {
    const double gone = 1 - static_cast<double>(run_pattern(c, p, s).oxygen_left[0]);
    return 1 - gone / (2 * c.initiator_mol_l);
  };
  const double fixed = initiator_left();
  s.bleaches = true;
  const double bleached = initiator_left();
  // Steps take the light of their beginning: to the first order of kd h.
  EXPECT_NEAR(bleached, std::log1p(std::expm1(3.0) * std::exp(-kd * 0.3)) / 3, 2 * kd * 1e-4);
  EXPECT_NEAR(fixed, std::exp(-kd * mean_light_share(c, s.film_um) * 0.3), 1e-4);
  EXPECT_LT(bleached, fixed - 0.1);
}

// --- judging ---

TEST(ChemistryFigures, OverlapAndDarkCells) {
  PatternRun run;
  run.width = 4;
  run.height = 1;
  const double never = std::numeric_limits<double>::infinity();
  run.gel_time_s = {1, 2, 3, never};
  LightPattern target{4, 1, {1, 1, 0, 0}};
  EXPECT_EQ(best_overlap(run, target).jaccard, 1);
  EXPECT_EQ(best_overlap(run, target).time_s, 2);
  const auto overlaps = overlap_over_time(run, target, 4, 8);
  EXPECT_EQ(overlaps[0].jaccard, 0);
  EXPECT_EQ(overlaps[3].jaccard, 0.5);
  EXPECT_NEAR(overlaps[8].jaccard, 2.0 / 3, 1e-12);
  run.gel_time_s = {1, 3, 2, never};
  const PatternFigures f = figures_of(run, target);
  EXPECT_EQ(f.lit, 2U);
  EXPECT_EQ(f.dark_gelled, 1U);
  EXPECT_EQ(f.last_lit_s, 3);
}

TEST(ChemistryFigures, ThinnestParts) {
  LightPattern p = dark(20, 20);
  EXPECT_EQ(thinnest_cells(p, Sides::periodic), 0);
  light_box(p, 5, 5, 6, 3);
  EXPECT_EQ(thinnest_cells(p, Sides::periodic), 3);
  LightPattern edge = dark(20, 20);
  light_box(edge, 0, 0, 2, 20);
  light_box(edge, 18, 0, 2, 20);
  EXPECT_EQ(thinnest_cells(edge, Sides::periodic), 4);
  EXPECT_EQ(thinnest_cells(edge, Sides::walls), 4);
}

// --- correction ---

LightPattern five_squares() {
  LightPattern t = dark(64, 64);
  const double squares[5][3] = {
      {80, 80, 100}, {240, 80, 50}, {80, 240, 30}, {240, 240, 50}, {180, 240, 30}};
  for (const auto& q : squares) {
    for (int y = 0; y < 64; ++y) {
      for (int x = 0; x < 64; ++x) {
        if (std::abs(x * 5 + 2.5 - q[0]) < q[2] / 2 && std::abs(y * 5 + 2.5 - q[1]) < q[2] / 2) {
          t.share[static_cast<std::size_t>(y * 64 + x)] = 1;
        }
      }
    }
  }
  return t;
}

TEST(ChemistryCorrection, SquaresGelTogetherAndNothingElse) {
  const LightPattern target = five_squares();
  PatternSetup s = setup_of(5, 1000, 1.2);
  s.spread_um = 8;
  const Overlap even = best_overlap(run_pattern(hydrogel(), target, s), target);
  EXPECT_NEAR(even.jaccard, 0.962, 0.02);
  PatternCorrection k;
  k.used_up_by_s = 0.3;
  const CorrectedPattern corrected = correct_pattern(hydrogel(), target, s, k);
  const Overlap best = best_overlap(run_pattern(hydrogel(), corrected.light, s), target);
  EXPECT_GT(best.jaccard, 0.998);
  EXPECT_NEAR(best.time_s, 0.56, 0.05);
  k.used_up_by_s = 0;
  const CorrectedPattern chosen = correct_pattern(hydrogel(), target, s, k);
  EXPECT_GT(best_overlap(run_pattern(hydrogel(), chosen.light, s), target).jaccard, 0.998);
  EXPECT_LT(chosen.most_outside, chosen.least_inside);
}

TEST(ChemistryCorrection, WhatCannotBeIsRefusedWithWhatWould) {
  const LightPattern target = five_squares();
  PatternSetup s = setup_of(5, 1000, 1);
  s.spread_um = 8;
  PatternCorrection k;
  k.used_up_by_s = 0.15;
  try {
    correct_pattern(hydrogel(), target, s, k);
    ADD_FAILURE() << "nothing was refused";
  } catch (const InfeasibleError& e) {
    EXPECT_THAT(e.what(), HasSubstr("mW/cm² would"));
  }
  // Gaps of a cell under light that spreads over five.
  LightPattern comb = dark(64, 64);
  for (int x = 0; x < 64; x += 2) light_box(comb, x, 0, 1, 64);
  s.spread_um = 25;
  k.used_up_by_s = 0;
  k.steps = 60;
  EXPECT_THROW(correct_pattern(hydrogel(), comb, s, k), InfeasibleError);
}

// --- bad input ---

TEST(ChemistryPattern, BadInputIsRefused) {
  LightPattern p = dark(4, 4);
  light_box(p, 1, 1, 2, 2);
  const auto refused = [&](PatternSetup s) {
    return test::refusal([&] { run_pattern(hydrogel(), p, s); });
  };
  const PatternSetup good = setup_of(5, 100, 0.1);
  const auto with = [&](double PatternSetup::*what, double value) {
    PatternSetup s = good;
    s.*what = value;
    return refused(s);
  };
  for (const double bad : {0.0, -1.0, static_cast<double>(NAN), static_cast<double>(INFINITY)}) {
    EXPECT_THAT(with(&PatternSetup::cell_um, bad), HasSubstr("cell"));
    EXPECT_THAT(with(&PatternSetup::intensity_mw_cm2, bad), HasSubstr("intensity"));
    EXPECT_THAT(with(&PatternSetup::light_s, bad), HasSubstr("time of light"));
  }
  EXPECT_THAT(with(&PatternSetup::spread_um, -1), HasSubstr("spread"));
  EXPECT_THAT(with(&PatternSetup::film_um, NAN), HasSubstr("film"));
  EXPECT_THAT(with(&PatternSetup::dark_s, -1), HasSubstr("dark"));
  // 25 / (4 · 277.25) s.
  EXPECT_THAT(with(&PatternSetup::step_s, 0.0226), HasSubstr("0.02254"));
  p.share[3] = 1.5F;
  EXPECT_THAT(refused(good), HasSubstr("1.5"));
  p.share.pop_back();
  EXPECT_THAT(refused(good), HasSubstr("one for each"));
  p.share.assign(16, 1.0F);
  Chemistry c = hydrogel();
  c.oxygen_um2_s.reset();
  EXPECT_THAT(test::refusal([&] { run_pattern(c, p, good); }),
              HasSubstr("how fast oxygen diffuses"));
  std::atomic<bool> stop = true;
  ExecutionContext context;
  context.cancel = &stop;
  EXPECT_THROW(run_pattern(hydrogel(), p, good, context), Cancelled);
}

}  // namespace
}  // namespace slicecorr
