// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <gtest/gtest.h>

#include <atomic>
#include <cmath>
#include <limits>

#include "slicecorr/error.hpp"
#include "slicecorr/tomo/solve.hpp"
#include "tomo/operators/axis_projector.hpp"
#include "tomo/projection/certificate.hpp"
#include "tomo_reference.hpp"

namespace slicecorr::tomo {
namespace {

struct Problem {
  TomoGrid grid;
  RayTables optics;
  Target target;
  std::unique_ptr<Projector> projector;

  explicit Problem(const Volume& part, double depth = 0, const Volume* insert = nullptr)
      : grid(part.grid),
        optics{.alpha_per_mm = depth / part.grid.radius_mm},
        target(part, insert),
        projector(make_projector(
            grid, optics,
            insert == nullptr ? nullptr : std::make_shared<Shadow>(cast_shadow(*insert)))) {}

  Solution solve(const SolveOptions& options) const {
    return tomo::solve({}, *projector, target, optics, options);
  }
};

TEST(TomoMetrics, OfACountedDose) {
  // Four gel and six void voxels; the rest of the disc is grey.
  const TomoGrid grid = square_grid(9, 8);
  Volume part(grid);
  Field dose(grid);
  std::fill(part.coverage.begin(), part.coverage.end(), std::uint8_t{128});
  const float gel[] = {0.5f, 0.7f, 0.9f, 1.0f}, empty[] = {0.1f, 0.2f, 0.3f, 0.4f, 0.6f, 0.8f};
  for (int i = 0; i < 4; ++i) {
    part.coverage[grid.voxel(2 + i, 4, 0)] = 255;
    dose.values[grid.voxel(2 + i, 4, 0)] = gel[i];
  }
  for (int i = 0; i < 6; ++i) {
    part.coverage[grid.voxel(1 + i, 5, 0)] = 0;
    dose.values[grid.voxel(1 + i, 5, 0)] = empty[i];
  }
  dose.values[grid.voxel(4, 6, 0)] = 7;  // grey: not judged
  const Target target(part);
  EXPECT_EQ(target.gel, 4u);
  EXPECT_EQ(target.empty, 6u);
  const Metrics m = measure(target, dose.values);
  EXPECT_EQ(m.void_gelled, 2u);
  EXPECT_DOUBLE_EQ(m.ver, 0.2);
  EXPECT_NEAR(m.pw, -0.3, 1e-7);
  EXPECT_NEAR(m.ipdr, 0.5, 1e-7);
  EXPECT_NEAR(m.contrast, 0.625, 1e-7);
  EXPECT_NEAR(m.trimmed_pw, m.pw, 1e-12);  // fewer than 2000 voxels: none is dropped
  // t = 0.5: 4/6, 0.7: 3/5, 0.9: 2/4, 1: 1/4.
  EXPECT_DOUBLE_EQ(m.best_jaccard, 4.0 / 6);
  EXPECT_EQ(m.best_threshold, 0.5f);
  EXPECT_DOUBLE_EQ(jaccard(target, dose.values, 0.7f), 3.0 / 5);
  EXPECT_DOUBLE_EQ(jaccard(target, dose.values, 0), 4.0 / 10);
}

TEST(TomoMetrics, TurnsScaleAndFloor) {
  const Problem p(t2(square_grid(41, 60)));
  Light light(p.grid);
  std::fill(light.values.begin(), light.values.end(), 2.0f);
  const Field dose = adjoint(*p.projector, {}, light);
  // Without absorption every voxel gets I from every angle: alpha_a T I = 0.5 * 10 * 2 per turn.
  const Exposure exposure{.alpha_a_per_cm = 0.5,
                          .turn_s = 10,
                          .critical_mj_cm3 = 35,
                          .black_mw_cm2 = 0.1,
                          .most_time_s = 0};
  const PrintTime time = plan_time({}, *p.projector, p.target, dose.values, exposure);
  EXPECT_EQ(time.turns, 4);
  EXPECT_DOUBLE_EQ(time.time_s, 40);
  EXPECT_NEAR(time.scale, 35.0 / 40, 1e-5);
  EXPECT_NEAR(time.floor_mj_cm3, 0.5 * 10 * 0.1 * 4, 1e-4);
  Exposure other = exposure;
  other.most_time_s = 39;
  EXPECT_THROW(plan_time({}, *p.projector, p.target, dose.values, other), InfeasibleError);
  other = exposure;
  other.black_mw_cm2 = 1.9;
  EXPECT_THROW(plan_time({}, *p.projector, p.target, dose.values, other), InfeasibleError);
  EXPECT_THROW(plan_time({}, *p.projector, p.target, Field(p.grid).values, exposure),
               InfeasibleError);
  other = exposure;
  other.critical_mj_cm3 = std::nan("");
  EXPECT_THROW(plan_time({}, *p.projector, p.target, dose.values, other), InputError);
  EXPECT_NEAR(efficiency(light), 1, 1e-12);
}

TEST(TomoMetrics, LevelsAreNearestInIntensity) {
  const std::vector<double> curve = {0.1, 0.2, 0.2, 1.0, 3.0};
  TomoGrid grid = square_grid(4, 3);
  Light light(grid);
  const float wanted[] = {0, 0.14f, 0.16f, 0.59f, 0.61f, 1.9f, 2.1f, 9, 0.5f};
  const int want[] = {0, 0, 1, 1, 3, 3, 4, 4, 1};
  for (int i = 0; i < 9; ++i) light.values[i] = wanted[i] / 2;
  const auto levels = nearest_levels(light, 2, curve);
  const Light shown = light_of_levels(grid, levels, curve);
  for (int i = 0; i < 9; ++i) {
    EXPECT_EQ(shown.values[i], static_cast<float>(curve[want[i]])) << i;
  }
  EXPECT_THROW(nearest_levels(light, 1, {0.2, 0.1}), InputError);
  EXPECT_THROW(nearest_levels(light, 1, {0.2, 0.2}), InputError);
  EXPECT_THROW(light_of_levels(grid, {1, 2}, curve), InputError);
}

/// What rounding takes at an angle the same pixel gets at the next, where levels can show it.
TEST(TomoMetrics, LevelsCarryWhatRoundingLeaves) {
  const TomoGrid grid = square_grid(4, 6);
  Light light(grid);
  // Pixel 0: 0.42 of a level at each angle; pixel 1: darker than black, then a level; pixel 2: brighter
  // than all; pixel 3: 1.3 levels.
  const float of_pixel[] = {0.42f, 0, 9, 1.3f};
  for (int m = 0; m < 6; ++m) {
    for (int i = 0; i < 4; ++i) light.values[grid.pixel(m, i, 0)] = of_pixel[i];
  }
  light.values[grid.pixel(5, 1, 0)] = 1.05f;
  const auto levels = carried_levels(light, 1, {0.1, 1.1, 2.1, 3.1});
  const int want[4][6] = {{0, 1, 0, 0, 1, 0},  // 0.42, 0.74 -> 1, 0.06, 0.38, 0.7 -> 1, 0.02
                          {0, 0, 0, 0, 0, 1},  // the light that black adds is no debt
                          {3, 3, 3, 3, 3, 3},
                          {1, 1, 2, 1, 1, 1}};  // 1.3, 1.5, 1.7 -> 2, 0.9, 1.1, 1.3
  for (int i = 0; i < 4; ++i) {
    for (int m = 0; m < 6; ++m) {
      EXPECT_EQ(levels[grid.pixel(m, i, 0)], want[i][m]) << i << ", " << m;
    }
  }
}

/// Science 2019, eq. 2, on a disc, before negative light is cut off: the mean inside is 1 to 0.013.
TEST(TomoFilter, AttenuatedInverseOfADisc) {
  const double alpha = 2;
  const TomoGrid grid = square_grid(256, 360);
  const Volume disc =
      part_of(grid, [](double x, double y, double) { return std::hypot(x, y) < .5; });
  Light lines = forward(*detail::make_axis_projector(grid, -alpha), {}, field_of(disc));
  ramp_filter({}, lines, Window::ram_lak, alpha);
  const Field dose = adjoint(*detail::make_axis_projector(grid, alpha), {}, lines);
  // Sums over voxels are lengths over h, |k| is over pi / h, 2 pi / M / (4 pi) is left.
  const double unit = std::numbers::pi / (2 * grid.angles);
  double sum = 0;
  int count = 0;
  for (int y = 0; y < 256; ++y) {
    for (int x = 0; x < 256; ++x) {
      if (std::hypot(grid.voxel_at_mm(x), grid.voxel_at_mm(y)) > .45) continue;
      sum += unit * dose.values[grid.voxel(x, y, 0)];
      ++count;
    }
  }
  EXPECT_NEAR(sum / count, 1, 0.013);
  const Problem p(disc, 1);
  EXPECT_GT(
      measure(p.target, adjoint(*p.projector, {}, filtered_start({}, p.target, p.optics)).values)
          .best_jaccard,
      0.97);
}

/// The ramp of a single bright pixel: sampled |k| over N is 1/4 of the largest at the pixel itself,
/// half of it, and falls as -1 / (pi k)^2 at odd distances (Ram and Lakshminarayanan).
TEST(TomoFilter, RampOfOnePixel) {
  const TomoGrid grid = square_grid(200, 3);
  Light light(grid);
  light.values[grid.pixel(1, 100, 0)] = 1;
  ramp_filter({}, light, Window::ram_lak);
  // |k| is 1 at the highest frequency, so the textbook's 1/4 and 1/(pi k)^2 are twice as large. A
  // transform of 512 repeats the tail: its sum beyond 256 is below 1e-4.
  EXPECT_NEAR(light.values[grid.pixel(1, 100, 0)], 0.5, 1e-4);
  for (const int k : {1, 3, 15}) {
    EXPECT_NEAR(light.values[grid.pixel(1, 100 + k, 0)], -2 / std::pow(std::numbers::pi * k, 2),
                1e-4);
    EXPECT_NEAR(light.values[grid.pixel(1, 100 + k + 1, 0)], 0, 1e-4);
  }
  EXPECT_NEAR(light.values[grid.pixel(0, 100, 0)], 0, 1e-7);
}

TEST(TomoOsmo, PublishedTargets) {
  const Problem one(t1(square_grid(256, 360))), two(t2(square_grid(256, 360)));
  const Solution a = one.solve(osmo(20)), b = two.solve(osmo(20));
  EXPECT_LE(a.metrics.ver, 3e-4);
  EXPECT_NEAR(a.metrics.pw, .053, .04);
  EXPECT_LE(b.metrics.ver, 3e-4);
  EXPECT_NEAR(b.metrics.pw, .005, .04);
  EXPECT_EQ(a.history.size(), 20u);
  EXPECT_NEAR(a.metrics.min_gel, 1, 1e-5);
}

TEST(TomoKelly, ReachesT1WithoutErrorAfterFiveSteps) {
  SolveOptions options;
  options.method = Method::kelly;
  options.steps = 6;  // the start and five
  const Solution s = Problem(t1(square_grid(256, 360))).solve(options);
  EXPECT_LE(s.metrics.ver, 3e-4);
  EXPECT_GT(s.metrics.best_jaccard, 0.999);
}

/// With process windows that are known of 256 voxels, or of other grids without.
void expect_rungs_are_reached(const TomoGrid& grid, bool known) {
  struct Row {
    Volume part;
    double depth, rho, pw;
  };
  for (const Row& row : {Row{t1(grid), 0, .8, .155}, Row{t2(grid), 0, .6, .320},
                         Row{t1(grid), 1, .8, .155}, Row{t2(grid), 1, .7, .274}}) {
    SCOPED_TRACE(std::to_string(row.depth) + ", " + std::to_string(row.rho));
    const Problem p(row.part, row.depth);
    const Solution s = p.solve(rung(row.rho, 120));
    EXPECT_EQ(s.metrics.ver, 0);
    // Which of the many patterns with that contrast is found decides the largest dose: on a rung
    // that is reached PW is (1 - rho) / max D, with max D at most d_u = 1.28 in gel.
    EXPECT_GE(s.metrics.pw, 0.95 * (1 - row.rho) / 1.28);
    if (known) {
      EXPECT_NEAR(s.metrics.pw, row.pw, 0.015);
    }
    EXPECT_GE(s.metrics.contrast, 0.99 / row.rho);
  }
}
TEST(TomoLadder, RungsAreReached) { expect_rungs_are_reached(square_grid(128, 180), false); }
TEST(TomoLadderNight, ProcessWindowsAtRungs) {
  expect_rungs_are_reached(square_grid(256, 360), true);
}

/// Depths at which a square prints and at which no light prints it.
TEST(TomoLadder, StrongAbsorption) {
  const TomoGrid grid = square_grid(64, 90);
  const Solution two = Problem(t2(grid), 2).solve({}), none = Problem(t2(grid), 2.5).solve({});
  EXPECT_EQ(two.metrics.ver, 0);
  EXPECT_GT(two.metrics.contrast, 1);
  EXPECT_GE(two.contrast_bound, two.metrics.contrast);
  EXPECT_LT(none.contrast_bound, 1);
  EXPECT_GE(none.contrast_bound, none.metrics.contrast);
  EXPECT_EQ(none.bound_slice, 0);
}

TEST(TomoLadderNight, StrongAbsorption) {
  const TomoGrid grid = square_grid(128, 180);
  // Light was found with these contrasts, so no right bound lies below them.
  SolveOptions options;
  const Solution two = Problem(t2(grid), 2).solve(options);
  EXPECT_GE(two.metrics.contrast, 1.10);
  EXPECT_GE(two.contrast_bound, 1.106);
  EXPECT_LE(two.contrast_bound, 1.16);
  const Solution one = Problem(t1(grid), 2).solve(options);
  EXPECT_EQ(one.metrics.ver, 0);
  EXPECT_GE(one.metrics.contrast, 1.003);
  EXPECT_GE(one.contrast_bound, 1.006);
  EXPECT_LE(one.contrast_bound, 1.06);
  const Solution none = Problem(t2(grid), 2.5).solve(options);
  EXPECT_LT(none.contrast_bound, 0.82);
  EXPECT_GE(none.contrast_bound, none.metrics.contrast);
  EXPECT_EQ(none.bound_slice, 0);
}

/// The bound holds for every light: of random doses as much as of solved ones, for any light.
TEST(TomoProof, HoldsForAnyLight) {
  for (const double depth : {0.0, 2.0}) {
    const Problem p(t1(square_grid(40, 30)), depth);
    const Solution solved = p.solve({});
    double least = std::numeric_limits<double>::infinity();
    for (const double rho : {.5, .8, .95}) {
      for (const double s : {.7, .9, 1.0, 1.1}) {
        Array<float> dose = solved.dose;
        for (float& d : dose) d *= static_cast<float>(s);
        least = std::min(
            least, detail::contrast_bounds({}, *p.projector, p.target, dose, rho, {0}).front());
      }
    }
    EXPECT_LT(least, 20);
    EXPECT_GE(std::min(least, solved.contrast_bound), solved.metrics.contrast);
    std::mt19937 random(3);
    Light light(p.grid);
    for (int i = 0; i < 20; ++i) {
      for (float& b : light.values) b = static_cast<float>(random() >> 16);
      EXPECT_LE(measure(p.target, adjoint(*p.projector, {}, light).values).contrast, least);
    }
  }
}

/// Eight slices hold a ring at the wall, which is easy; one a square in the middle, which is not.
TEST(TomoProof, NamesTheSlice) {
  const TomoGrid grid = square_grid(48, 40, 9);
  const Problem p(part_of(grid,
                          [](double x, double y, double z) {
                            return z == 0 ? std::abs(x) < .45 && std::abs(y) < .45
                                          : std::hypot(x, y) > .8;
                          }),
                  3);
  const Solution s = p.solve({});
  EXPECT_LT(s.contrast_bound, 1);
  EXPECT_EQ(s.bound_slice, 4);
}

TEST(TomoInsert, T3AroundItsInsert) {
  const TomoGrid grid = square_grid(256, 360);
  const Volume insert = t3_insert(grid);
  const Problem p(t3(grid), 0, &insert);
  const Solution s = p.solve(osmo(20));
  EXPECT_LE(s.metrics.ver, 3e-4);
  EXPECT_GT(s.metrics.best_jaccard, 0.999);
}

TEST(TomoInsert, GelBehindOpaqueWallsIsNamed) {
  const TomoGrid grid = square_grid(64, 40);
  const Volume wall = part_of(grid, [](double x, double y, double) {
    return std::hypot(x, y) > .3 && std::hypot(x, y) < .5;
  });
  const Problem p(part_of(grid, [](double x, double y, double) { return std::hypot(x, y) < .1; }),
                  0, &wall);
  try {
    p.solve({});
    FAIL();
  } catch (const InfeasibleError& error) {
    EXPECT_NE(std::string(error.what()).find("voxel"), std::string::npos) << error.what();
  }
}

TEST(TomoLadder, CapIsKeptInside) {
  const Problem p(t2(square_grid(96, 90)));
  SolveOptions options = rung(.9, 300);
  const Solution free = p.solve(options);
  const float most = *std::max_element(free.light.begin(), free.light.end());
  options.cap = 0.4 * most;
  const Solution capped = p.solve(options);
  const float capped_most = *std::max_element(capped.light.begin(), capped.light.end());
  // The loss became 0, so the weakest voxel had a dose of 1 or more, and the light was scaled down.
  ASSERT_EQ(capped.history.back().loss, 0);
  EXPECT_LE(capped_most, options.cap * (1 + 1e-6));
  EXPECT_EQ(capped.metrics.ver, 0);
  EXPECT_GT(efficiency({p.grid, capped.light}), 1.5 * efficiency({p.grid, free.light}));
}

TEST(TomoLadder, SlicesAreIndependentAndThreadsChangeNothing) {
  const TomoGrid grid = square_grid(40, 36, 40);
  const Problem p(gyroid(grid));
  SolveOptions options = rung(.9, 20);
  const Solution one = solve(on_threads(1), *p.projector, p.target, p.optics, options);
  const Solution two = solve(on_threads(2), *p.projector, p.target, p.optics, options);
  EXPECT_EQ(one.light, two.light);
  EXPECT_EQ(one.metrics.contrast, two.metrics.contrast);
  for (const Method method : {Method::osmo, Method::kelly, Method::fbp}) {
    options.method = method;
    options.steps = 3;
    EXPECT_EQ(solve(on_threads(1), *p.projector, p.target, p.optics, options).light,
              solve(on_threads(2), *p.projector, p.target, p.optics, options).light);
  }
}

/// Slices are put together by what they have left to do, whichever these are, and a block that is
/// alone is shared among threads.
TEST(TomoLadder, ThreadsChangeNothingWhereFewSlicesHaveGel) {
  const TomoGrid grid = square_grid(40, 36, 40);
  for (const int every : {3, 11, 39}) {
    const Problem p(part_of(grid, [&](double x, double y, double z) {
      const int slice = static_cast<int>(std::lround(19.5 * (z + 1)));
      const double side = 0.2 + 0.005 * slice;
      return slice % every == 1 && std::abs(x) < side && std::abs(y) < 0.4;
    }));
    SolveOptions options;
    options.rungs = {.9, .5};
    options.steps = options.most_steps = 40;
    options.proof_steps = 20;
    const Solution one = solve(on_threads(1), *p.projector, p.target, p.optics, options);
    const Solution more = solve(on_threads(3), *p.projector, p.target, p.optics, options);
    EXPECT_EQ(one.light, more.light);
    EXPECT_EQ(one.contrast_bound, more.contrast_bound);
    // The others stay dark.
    for (int z = 0; z < grid.slices; ++z) {
      if (z % every == 1) continue;
      for (int m = 0; m < grid.angles; ++m) {
        for (int i = 0; i < grid.pixels; ++i) ASSERT_EQ(one.light[grid.pixel(m, i, z)], 0);
      }
    }
    EXPECT_EQ(one.metrics.ver, 0);
    EXPECT_GE(one.metrics.contrast, 1 / .9);
    EXPECT_NEAR(one.metrics.min_gel, 1, 1e-5);
  }
}

/// A slice may turn out to have reached its rung when its dose is computed afresh.
TEST(TomoLadder, EndsWhereSumsOverStepsRound) {
  const Problem p(gyroid(square_grid(24, 90, 24)));
  SolveOptions options;
  options.proof_steps = 40;
  const Solution s = p.solve(options);
  EXPECT_EQ(s.metrics.ver, 0);
  EXPECT_GE(s.metrics.contrast, 1.1);
  EXPECT_GE(s.contrast_bound, s.metrics.contrast);
}

/// A solve that goes on from any place that it passed ends in the same bytes.
TEST(TomoSolve, GoesOnFromWhereItStood) {
  struct Case {
    Method method;
    double depth;
    int places;
  };
  // The ladder of the third case misses its last rung, and proves it.
  for (const Case& c : {Case{Method::osmo, 0, 4}, Case{Method::kelly, 0, 5},
                        Case{Method::ladder, 2, 2}, Case{Method::ladder, 0, 3}}) {
    const Problem p(t1(square_grid(64, 60)), c.depth);
    SolveOptions options;
    options.method = c.method;
    options.steps = c.method == Method::ladder ? 30 : 5;
    options.most_steps = 30;
    options.rungs = {.95, .9, .85};
    std::vector<SolverState> places;
    options.checkpoint = [&](const SolverPlace& at) {
      places.push_back({at.numbers, at.dose, at.of_slices, at.missed, at.rung, at.step, at.best});
    };
    const Solution whole = p.solve(options);
    EXPECT_GE(static_cast<int>(places.size()), c.depth > 0 ? 1 : c.places);
    if (c.depth > 0) {
      EXPECT_FALSE(places.back().missed.empty());
      EXPECT_LT(whole.contrast_bound, 10);
    }
    options.checkpoint = nullptr;
    for (const SolverState& place : places) {
      options.resume = &place;
      const Solution again = p.solve(options);
      EXPECT_EQ(whole.light, again.light);
      EXPECT_EQ(whole.dose, again.dose);
      EXPECT_EQ(whole.rung, again.rung);
      EXPECT_EQ(whole.contrast_bound, again.contrast_bound);
      EXPECT_EQ(whole.history.size(), again.history.size());
      EXPECT_EQ(whole.metrics.pw, again.metrics.pw);
    }
    const SolverState other{};
    options.resume = &other;
    EXPECT_THROW(p.solve(options), InputError);
  }
}

/// Webber 2023: light above mean + 3 sigma cut off, 8 bit, and an end at a relative error of 0.5 %.
TEST(TomoOsmo, WebbersClipAndEnd) {
  const Problem p(t1(square_grid(96, 90)));
  SolveOptions options = osmo(40);
  options.clip_sigma = 3;
  const Solution s = p.solve(options);
  double sum = 0, squares = 0, most = 0;
  for (const float v : s.light) most = std::max<double>(most, v);
  for (const float v : s.light) {
    EXPECT_NEAR(v / most * 255, std::round(v / most * 255), 1e-3);
    sum += v;
    squares += static_cast<double>(v) * v;
  }
  const Solution free = p.solve(osmo(40));
  const auto n = static_cast<double>(free.light.size());
  double free_sum = 0, free_squares = 0, free_most = 0;
  for (const float v : free.light) {
    free_sum += v;
    free_squares += static_cast<double>(v) * v;
    free_most = std::max<double>(free_most, v);
  }
  const double mean = free_sum / n, sigma = std::sqrt(free_squares / n - mean * mean);
  ASSERT_GT(free_most, mean + 3 * sigma);
  // Cut at the same share of the mean, but for what rounding to levels adds.
  std::size_t cut = 0, at_most = 0;
  for (const float v : free.light) cut += v >= (mean + 3 * sigma) * (1 - 0.5 / 255);
  for (const float v : s.light) at_most += v == static_cast<float>(most);
  EXPECT_EQ(at_most, cut);
  EXPECT_GT(efficiency({p.grid, s.light}), efficiency({p.grid, free.light}));

  options = osmo(200);
  options.stop_error = 0.01;
  const Solution ended = p.solve(options);
  EXPECT_LT(ended.history.size(), 200u);
  EXPECT_GT(ended.history.size(), 2u);
}

TEST(TomoLadder, StopsWhenAsked) {
  const Problem p(t1(square_grid(96, 90)));
  std::atomic<bool> cancel = false;
  ExecutionContext context;
  context.cancel = &cancel;
  SolveOptions options;
  options.checkpoint = [&](const SolverPlace&) { cancel = true; };
  for (const Method method : {Method::ladder, Method::osmo, Method::kelly}) {
    cancel = false;
    options.method = method;
    EXPECT_THROW(solve(context, *p.projector, p.target, p.optics, options), Cancelled);
  }
}

TEST(TomoLadder, RefusesOptionsOutOfRange) {
  const Problem p(t1(square_grid(40, 30)));
  const auto refused = [&](auto&& change) {
    SolveOptions options;
    change(options);
    EXPECT_THROW(p.solve(options), InputError);
  };
  refused([](SolveOptions& o) { o.steps = -1; });
  refused([](SolveOptions& o) { o.memory = 0; });
  refused([](SolveOptions& o) { o.most_dose = 1; });
  refused([](SolveOptions& o) { o.most_dose = std::nan(""); });
  refused([](SolveOptions& o) { o.cap = -1; });
  refused([](SolveOptions& o) { o.clip_sigma = -1; });
  refused([](SolveOptions& o) { o.stop_error = std::nan(""); });
  refused([](SolveOptions& o) { o.rungs = {}; });
  refused([](SolveOptions& o) { o.rungs = {.5, .8}; });
  refused([](SolveOptions& o) { o.rungs = {1.0}; });
  refused([](SolveOptions& o) { o.osmo_low = o.osmo_high; });
  const Array<float> other(square_grid(41, 30).shape().light());
  refused([&](SolveOptions& o) { o.start = &other; });
}

}  // namespace
}  // namespace slicecorr::tomo
