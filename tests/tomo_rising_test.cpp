// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Light of a point, or through an aperture, in vials that are not round and around rods: operators and judge against
// rays in vectors that know no n', no bundles and no closed form; and against the closed forms of round vials.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <string>
#include <vector>

#include "slicecorr/error.hpp"
#include "slicecorr/tomo/limits.hpp"
#include "slicecorr/tomo/print.hpp"
#include "tomo_pair.hpp"
#include "tomo_regions.hpp"

namespace slicecorr::tomo::traced_test {
namespace {

/// A point so near that light of a part 4.6 mm above its axis rises by up to 13 degrees in air.
Printer from_a_point(Printer p) {
  p.optics->kind = OpticsKind::pinhole;
  p.optics->distance_mm = 25;
  p.optics->axis_up_px = -20;
  p.height_px = 12;
  return p;
}
MarchOptions high_up(int angles = 12) { return {{0.25, 3, angles, false, 4.6}, 120000, 15000}; }

TEST(TomoRising, RaysOfAPointAgreeInASquareVial) {
  expect_march_agrees({rounded(2, 2, 0), rounded(1.7, 1.7, 0), {}},
                      from_a_point(square_printer(0, 1)), high_up());
}
TEST(TomoRising, RaysOfAPointAgreeInAnOutline) {
  Printer p = square_printer(0, 1.33);
  p.vial->shape = VialShape::outline;
  for (int k = 0; k < 6; ++k) {
    const double at = pi / 3 * (k + 0.5) + 0.1, r = 2.2 / std::cos(pi / 6);
    p.vial->outline.push_back({r * std::cos(at), r * std::sin(at)});
  }
  set_radii(*p.vial);
  expect_march_agrees({hexagon(2.2), hexagon(1.9), {}}, from_a_point(p), high_up());
}
TEST(TomoRising, RaysOfAPointAgreeAroundRods) {
  Printer p = small_printer(true, 0.25);
  p.vial->rods = {{0.6, -0.3, 1.2, 1.62, 0}, {-0.9, -0.6, 0.5, 0, 0.8}};
  expect_march_agrees({disc(0, 0, 2.25),
                       disc(0, 0, 2),
                       {{disc(0.6, -0.3, 0.6), 1.62, 0}, {disc(-0.9, -0.6, 0.25), 0, 0.8}}},
                      from_a_point(p), high_up());
}
TEST(TomoRising, RaysThroughAnApertureAgreeInASquareVial) {
  Printer p = square_printer(0, 1);
  p.optics->half_angle_deg = 6;
  p.optics->rays_per_pixel = 13;
  p.height_px = 8;
  p.width_px = 20;
  expect_march_agrees({rounded(2, 2, 0), rounded(1.7, 1.7, 0), {}}, p,
                      {{0.25, 2, 8}, 120000, 15000});
}

/// A rod of the resin's index is none: what remains is a round vial, whose rays are known in closed form.
TEST(TomoRising, ARoundVialInDisguise) {
  Printer round = from_a_point(small_printer(true, 0.25)), rod = round;
  rod.vial->rods = {{5e-4, 0, 1e-3, 1.5, 0}};
  std::mt19937 random(5);
  const auto light = [&](int, int, int) { return random() % 2 * 255; };
  TomoJob job = job_of_light(round, bench_resin(2), high_up().sampling, light), traced = job;
  traced.printer = rod;
  ASSERT_EQ(make_bench(rod, job.resin, job.sampling).grid,
            make_bench(round, job.resin, job.sampling).grid);
  for (const JudgedAt at : {JudgedAt::means, JudgedAt::centres}) {
    const Box<float> want = dose_of(job, {}, at), got = dose_of(traced, {}, at);
    const double most = largest(want);
    const int n = want.nx;
    int all = 0;
    for (int z = 0; z < want.nz; ++z) {
      for (int y = 0; y < n; ++y) {
        for (int x = 0; x < n; ++x) {
          if (0.25 * std::hypot(x - n / 2, y - n / 2) > 1.3 || (x == n / 2 && y == n / 2)) continue;
          ++all;
          // Closed forms are right to 1 % of large weights, strips that bend to 1 % more, and a voxel's light is that of
          // many; centres lie on edges of pixels' light more or less.
          EXPECT_NEAR(got.values[want.at(z, y, x)], want.values[want.at(z, y, x)],
                      (at == JudgedAt::means ? 0.025 : 0.06) * most);
        }
      }
    }
    EXPECT_GT(all, 200);
  }
}

TEST(TomoRising, OperatorsAreTransposesForAnyNumberOfThreads) {
  Printer p = from_a_point(square_printer(0.5, 1));
  p.vial->rods = {{0.4, 0.5, 0.8, 1.7, 0}};
  p.optics->half_angle_deg = 3;
  p.optics->rays_per_pixel = 3;
  p.fill_factor = 0.7;
  const Bench bench = make_bench(p, bench_resin(), {0.25, 4, 10, false, 4.6});
  ASSERT_TRUE(bench.grid.coupled());
  const auto projector = make_projector(bench);
  const RandomPair random(bench.grid);
  expect_transposes(*projector, random);
  expect_same_for_any_threads(*projector, *make_projector(bench), random);
}

/// A bar high above the axis of a point in a dry square vial is printed by frames that are found for it.
TEST(TomoRising, SolvingCountsIt) {
  Printer p = from_a_point(square_printer(0, 1));
  p.height_px = 20;
  const Resin resin = bench_resin(0.5);
  const int n = voxels_across(p, 0.25), c = n / 2;
  Box<std::uint8_t> part{6, n, n, std::vector<std::uint8_t>(static_cast<std::size_t>(6 * n * n))};
  for (int z = 2; z < 4; ++z) {
    for (int y = -3; y <= 3; ++y) {
      for (int x = -1; x <= 1; ++x) part.values[part.at(z, c + y, c + x)] = 255;
    }
  }
  PrintOptions options;
  options.angles = 36;
  options.solve.method = Method::osmo;
  options.middle_z_mm = 4.6;
  const Print counted = solve_print(part, 0.25, p, resin, options);
  EXPECT_GT(counted.figures.metrics.contrast, 1);
  EXPECT_EQ(counted.figures.metrics.void_gelled, 0U);
  RecordProperty("counted", std::to_string(counted.figures.metrics.contrast));
  EXPECT_FALSE(limits_of(p, resin, {}).turned.empty());
}

}  // namespace
}  // namespace slicecorr::tomo::traced_test
