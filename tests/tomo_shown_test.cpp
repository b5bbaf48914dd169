// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// What a vial was really shown, and what that prints.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "refusal.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/tomo/shown.hpp"
#include "stack_fixture.hpp"
#include "tomo_jobs.hpp"

namespace slicecorr::tomo {
namespace {

/// Each frame of each turn at its own angle plus `late_deg`, over `width_deg` about it.
std::vector<Showing> shown_of(const TomoJob& job, double late_deg, double width_deg) {
  std::vector<Showing> shown;
  const double turn_s = 360 / job.printer.rotation->deg_s;
  const int angles = job.sampling.angles;
  for (int n = 0; n < job.turns * angles; ++n) {
    const double at = 360.0 * n / angles + late_deg;
    shown.push_back({n % angles, at - width_deg / 2, at + width_deg / 2, turn_s / angles, 1});
  }
  return shown;
}

/// Largest difference over the largest dose, up to this share of the radius. Doses are single
/// precision: 6e-8 of each.
double difference(const Box<float>& a, const Box<float>& b, double within = 1) {
  double most = 0;
  const double middle = (a.nx - 1) / 2.0;
  for (int z = 0; z < a.nz; ++z) {
    for (int y = 0; y < a.ny; ++y) {
      for (int x = 0; x < a.nx; ++x) {
        if (std::hypot(x - middle, y - middle) > within * middle) continue;
        most = std::max(most, std::abs(double{a.values[a.at(z, y, x)]} - b.values[b.at(z, y, x)]));
      }
    }
  }
  return most / largest(b);
}

TEST(TomoShown, FramesAtTheirOwnAnglesGiveTheDoseOfTheJob) {
  const TomoJob job = random_job(bench_printer(), 2, 20);
  EXPECT_LT(difference(dose_of(job, shown_of(job, 0, 18)), dose_of(job)), 1e-6);
  TomoJob smooth = random_job(dry_printer(), 1, 72);
  const Bench bench = make_bench(smooth.printer, smooth.resin, smooth.sampling);
  for (int m = 0; m < 72; ++m) {
    for (int i = 0; i < bench.grid.pixels; ++i) {
      smooth.levels[bench.grid.pixel(m, i, 0)] =
          static_cast<std::uint16_t>(std::lround(128 + 100 * std::cos(m * std::numbers::pi / 36)));
    }
  }
  EXPECT_LT(difference(dose_of(smooth, shown_of(smooth, 0, 5)), dose_of(smooth)), 1e-6);
}

TEST(TomoShown, AQuarterTurnLateIsThePartTurned) {
  for (const TurnDirection way : {TurnDirection::clockwise, TurnDirection::counterclockwise}) {
    Printer printer = bench_printer();
    printer.rotation->direction = way;
    const TomoJob job = random_job(printer, 1, 20);
    const Box<float> planned = dose_of(job), late = dose_of(job, shown_of(job, 90, 18));
    Box<float> turned = planned;
    const int last = planned.nx - 1;
    for (int y = 0; y <= last; ++y) {
      for (int x = 0; x <= last; ++x) {
        // Clockwise: t of (x, y) at th + 90° is that of (y, -x) at th.
        turned.values[turned.at(0, y, x)] = way == TurnDirection::clockwise
                                                ? planned.values[planned.at(0, last - x, y)]
                                                : planned.values[planned.at(0, x, last - y)];
      }
    }
    EXPECT_LT(difference(late, turned), 1e-6);
  }
}

TEST(TomoShown, EvenLightPrintsTheSameAtAnyAngleAndForAnyWidth) {
  // 72 angles: away from the wall, where the way through the resin changes as a square root, the sum
  // over them of exp(-alpha (half chord + u)) is the integral, to far less than 1e-6. Parts of a step
  // have one direction each, in which the way is off by (alpha u turn)^2 / 24 in the mean over one.
  TomoJob job = random_job(bench_printer(), 1, 72);
  std::fill(job.levels.begin(), job.levels.end(), std::uint16_t{200});
  const Box<float> planned = dose_of(job);
  EXPECT_LT(difference(dose_of(job, shown_of(job, 1.3, 5)), planned, 0.5), 5e-5);
  EXPECT_LT(difference(dose_of(job, shown_of(job, -2, 400)), planned, 0.5), 5e-5);
  // Doses are light times time; black adds its own.
  std::vector<Showing> shown = shown_of(job, 0, 5);
  for (Showing& s : shown) s.share = 0.5, s.exposed_s *= 3;
  const double turn_s = 360 / job.printer.rotation->deg_s;
  shown.push_back({kBlackFrame, 10, 370, turn_s * job.turns, 1});
  Box<float> expected = planned;
  const Bench bench = make_bench(job.printer, job.resin, job.sampling);
  for (float& d : expected.values) {
    d = static_cast<float>(d * (1.5 + bench.mw_cm2[0] / bench.mw_cm2[200]));
  }
  EXPECT_LT(difference(dose_of(job, shown), expected, 0.5), 5e-5);
}

TEST(TomoShown, ASmearedFrameIsTheMeanOfItsPlaces) {
  // Over a step: the mean of its fifths. As a whole it is cut into directions of two voxels' way, in
  // which sides of voxels seem as wide as in the middle: off by (18 degrees / 3)^2 / 24 of them.
  const TomoJob job = random_job(bench_printer(), 1, 20);
  Box<float> mean = dose_of(job);
  std::fill(mean.values.begin(), mean.values.end(), 0.0F);
  for (int i = -2; i <= 2; ++i) {
    const Box<float> one = dose_of(job, shown_of(job, i * 18.0 / 5, 0));
    for (std::size_t k = 0; k < mean.values.size(); ++k) mean.values[k] += one.values[k] / 5;
  }
  EXPECT_LT(difference(dose_of(job, shown_of(job, 0, 18)), mean), 2e-3);
}

/// An axis that leans and goes astray, by whole rows too, and light that is dim at the sides.
Printer uneven_printer(TurnDirection way) {
  Printer p = bench_printer();
  p.width_px = p.height_px = 64;
  p.rotation->direction = way;
  p.optics->tilt_deg = 3;
  for (int k = 0; k < 20; ++k) {
    const double a = k * std::numbers::pi / 10;
    p.rotation->wobble.push_back(
        {18.0 * k, 0.9 * std::sin(a) + 0.4 * std::cos(3 * a), 2.2 * std::sin(a)});
  }
  p.flat_field = field_of(64, 64, [](int x, int y) {
    return static_cast<int>(std::lround(220 - 2.0 * std::abs(x - 30) - 1.5 * std::abs(y - 36)));
  });
  return p;
}

TEST(TomoShown, FramesAtTheirOwnAnglesGiveTheDoseOfAnyMachine) {
  for (const TurnDirection way : {TurnDirection::clockwise, TurnDirection::counterclockwise}) {
    const TomoJob all = random_job(uneven_printer(way), 6, 20);
    TomoJob steady = all, even = all;
    steady.printer.optics->tilt_deg = 0;
    steady.printer.rotation->wobble.clear();
    even.printer.flat_field.reset();
    for (const TomoJob& job : {all, steady, even}) {
      EXPECT_LT(difference(dose_of(job, shown_of(job, 0, 18)), dose_of(job)), 1e-6);
    }
    // Each of them counts: without it the dose is another.
    EXPECT_GT(difference(dose_of(steady), dose_of(all)), 0.02);
    EXPECT_GT(difference(dose_of(even), dose_of(all)), 0.02);
  }
}

TEST(TomoShown, BlackIsAsUnevenAsAllLight) {
  // A job of black frames, and black that is no frame.
  TomoJob job = random_job(uneven_printer(TurnDirection::counterclockwise), 6, 20);
  std::fill(job.levels.begin(), job.levels.end(), std::uint16_t{0});
  std::vector<Showing> black = shown_of(job, 0, 18);
  for (Showing& s : black) s.frame = kBlackFrame;
  const Box<float> dose = dose_of(job);
  ASSERT_GT(largest(dose), 0);
  EXPECT_LT(difference(dose_of(job, black), dose), 1e-6);
  TomoJob even = job;
  even.printer.flat_field.reset();
  EXPECT_GT(difference(dose_of(even, black), dose), 0.05);
}

TEST(TomoShown, AFrameShownElsewhereLightsWhatIsThere) {
  // Over half of the turn the axis lies two rows higher, and rows are as high as voxels: a frame of
  // the other half falls two slices lower into the part, and black comes in from above.
  Printer p = bench_printer();
  p.height_px = 64;
  for (int k = 0; k < 20; ++k) p.rotation->wobble.push_back({18.0 * k, 0, k < 10 ? 0.0 : 2.0});
  TomoJob job = random_job(p, 8, 20);
  const Bench bench = make_bench(job.printer, job.resin, job.sampling);
  const auto level_of = [](int z) {
    return static_cast<std::uint16_t>(z < 0 || z > 7 ? 0 : 25 * (z + 2));
  };
  const auto fill = [&](int shift) {
    TomoJob made = job;
    for (int m = 0; m < 20; ++m) {
      for (int i = 0; i < bench.grid.pixels; ++i) {
        for (int z = 0; z < 8; ++z) made.levels[bench.grid.pixel(m, i, z)] = level_of(z + shift);
      }
    }
    return made;
  };
  const std::vector<Showing> low{{0, 0, 0, 1, 1}}, high{{0, 180, 180, 1, 1}},
      of_high{{10, 180, 180, 1, 1}}, of_high_low{{10, 0, 0, 1, 1}};
  EXPECT_LT(difference(dose_of(fill(0), high), dose_of(fill(2), of_high)), 1e-6);
  EXPECT_LT(difference(dose_of(fill(0), of_high_low), dose_of(fill(-2), low)), 1e-6);
  // The pixel's own light, wherever it falls: of a flat-field of rows too.
  job.printer.flat_field = field_of(48, 64, [](int, int y) { return 100 + 2 * y; });
  EXPECT_LT(difference(dose_of(fill(0), high), dose_of(fill(2), of_high)), 1e-6);
}

TEST(TomoShown, TablesAreReadAndRefused) {
  const test::TemporaryFolder folder;
  const std::string path = folder / "shown.csv";
  const auto read = [&](const std::string& text) {
    test::write_file(path, test::to_bytes(text));
    return read_shown(path, 20);
  };
  const std::string head = "frame,job_frame,from_deg,to_deg,exposed_s,blue_measured\n";
  const Shown shown = read(head + "0,-1,-9,1,0.5,1\n21,1,369,387,0.72,0.98\n22,2,387,,,1\n");
  EXPECT_EQ(shown.without_end, 1);
  ASSERT_EQ(shown.showings.size(), 2U);
  EXPECT_EQ(shown.showings[1], (Showing{1, 369, 387, 0.72, 0.98}));
  EXPECT_DOUBLE_EQ(shown.light_s(), 0.72 * 0.98);
  const auto refused = [&](const std::string& text, const std::string& what) {
    SCOPED_TRACE(text);
    EXPECT_NE(test::refusal([&] { read(text); }).find(what), std::string::npos);
  };
  refused("", "is empty");
  refused("frame,z_um\n0,1\n", "job_frame");
  refused(head, "has no light in it");
  refused(head + "0,0,-9,9,0.72,0\n1,1,9,27,0,1\n", "as of a dry run");
  refused(head + "0,20,0,1,1,1\n", "job_frame");
  refused(head + "0,0.5,0,1,1,1\n", "whole number");
  refused(head + "0,0,0,1,-1,1\n", "exposed_s");
  refused(head + "0,0,nan,1,1,1\n", "from_deg");
  refused(head + "0,0,0,1,1\n", "5 cells");
}

}  // namespace
}  // namespace slicecorr::tomo
