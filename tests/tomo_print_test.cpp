// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// From a part to a job's frames and back to doses: benches, jobs, direct sums.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <random>
#include <tuple>

#include "rounds.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/load_printer.hpp"
#include "slicecorr/tomo/print.hpp"
#include "stack_fixture.hpp"
#include "tomo_jobs.hpp"

namespace slicecorr::tomo {
namespace {

using testing::HasSubstr;

TEST(TomoBench, UniformLightInABathIsTheClosedForm) {
  // tomography.md: alpha 0.8/cm, R 12.5, I 2, T_rot 14.4: 8.4759 on the axis.
  TomoJob job;
  job.printer = load_printer(SLICECORR_PRINTERS_DIR "/model-tomography-bench.toml");
  job.resin = load_resin(SLICECORR_DB_DIR "/model-tomography-resin.toml");
  // Sums over angles of a dose as smooth as this are exact to the share of the radius, at most 1/2,
  // to the power of their number.
  job.sampling = {0.25, 1, 60};
  const Bench bench = make_bench(job.printer, job.resin, job.sampling);
  EXPECT_NEAR(bench.alpha_r, 1.0, 1e-9);
  EXPECT_EQ(bench.grid.voxels, 101);
  job.levels.assign(bench.grid.blocks() * bench.grid.light_of_block(), 255);
  const Box<float> dose = dose_of(job);
  const int middle = 50;
  // Means over voxels of 0.25 mm. Beside the axis e^(-alpha l), in the mean over directions, is
  // e^(-alpha R) (1 + r^2 (alpha^2 + alpha / R) / 4), and r^2 is 0.25^2 / 6 in the mean over a voxel.
  const double more = 0.25 * 0.25 / 24 * (0.08 * 0.08 + 0.08 / 12.5);
  EXPECT_NEAR(dose.values[dose.at(0, middle, middle)], 8.4759 * (1 + more), 1e-4);
  // Half way to the wall .417465 of alpha_a I T_rot, by as much more.
  EXPECT_NEAR(dose.values[dose.at(0, middle, 25)], 0.417465 * 0.8 * 2 * 14.4, 4e-4);
}

TEST(TomoBench, TheOperatorsSayWhatTheDirectSumSays) {
  // Smooth light, 1 + 0.5 sin over the pixels + 0.3 sin over the angles, up to 2.2 mm of 4. The
  // operators weigh light at pixels and then interpolate, the direct sum does it the other way.
  // Relative to light of 1, they differ by
  // - p/4 of the weights' slope times the light's step: 0.25 (0.041) (0.19) = 0.002,
  // - p^2/8 of the weights' curvature: 0.0010 times light of up to 1.8,
  // - in a dry vial, whose pixels are turned by up to 0.54 of a frame against each other, by what
  //   lines miss of the light between frames, 0.0131/8, twice, and of its bend between pixels,
  //   0.0005 and as much for the bend of the turn.
  for (const Printer& printer : {bench_printer(), dry_printer()}) {
    for (const int slices : {3, 20}) {
      TomoJob job = random_job(printer, slices, 90);
      const Bench bench = make_bench(job.printer, job.resin, job.sampling);
      const TomoGrid& g = bench.grid;
      for (int m = 0; m < g.angles; ++m) {
        for (int i = 0; i < g.pixels; ++i) {
          const double light = 1 + 0.5 * std::sin(4 * std::numbers::pi * i / g.pixels) +
                               0.3 * std::sin(6 * std::numbers::pi * m / g.angles);
          for (int z = 0; z < slices; ++z) {
            job.levels[g.pixel(m, i, z)] = static_cast<std::uint16_t>(std::lround(100 * light));
          }
        }
      }
      const Field field =
          adjoint(*make_projector(g, bench.rays), {}, light_of_levels(g, job.levels, bench.mw_cm2));
      const Box<float> direct = dose_of(job);
      const double unit = dose_of_turn(g, bench.exposure) * job.turns;
      double largest = 0, off = 0;
      for (int z = 0; z < slices; ++z) {
        for (int y = 0; y < g.voxels; ++y) {
          for (int x = 0; x < g.voxels; ++x) {
            if (std::hypot(g.voxel_at_mm(x), g.voxel_at_mm(y)) > 2.2) continue;
            const double d = direct.values[direct.at(z, y, x)];
            largest = std::max(largest, d);
            off = std::max(off, std::abs(d - unit * field.values[g.voxel(x, y, z)]));
          }
        }
      }
      const bool matched = bench.rays.turn_rad.empty();
      EXPECT_EQ(matched, printer.vial->n_outside == 1.5);
      EXPECT_LE(off, (matched ? 0.004 : 0.009) * largest);
    }
  }
}

/// Uniform light round a disc: the share 1 - asin(a/r)/pi of the directions is seen (tomography.md).
TEST(TomoInserts, ADiscShadesAsManyDirectionsAsTheClosedFormSays) {
  TomoJob job;
  job.printer = bench_printer();
  job.printer.pixel_x_um = job.printer.pixel_y_um = 100;
  job.printer.width_px = 100;
  job.resin = bench_resin(0.01);
  const int angles = test::by_night() ? 360 : 180;
  job.sampling = {0.1, 70, angles};  // more slices than bits in a word
  job.printer.height_px = 70;
  const Bench bench = make_bench(job.printer, job.resin, job.sampling);
  const TomoGrid& g = bench.grid;
  job.levels.assign(g.blocks() * g.light_of_block(), 255);
  const Box<float> free = dose_of(job);
  const double radius = 1.0;
  job.insert = {g.slices, g.voxels, g.voxels, {}};
  job.insert.values.assign(free.values.size(), 0);
  for (const int z : {1, 68}) {
    for (int y = 0; y < g.voxels; ++y) {
      for (int x = 0; x < g.voxels; ++x) {
        if (std::hypot(g.voxel_at_mm(x), g.voxel_at_mm(y)) < radius) {
          job.insert.values[job.insert.at(z, y, x)] = 1;
        }
      }
    }
  }
  const Box<float> dose = dose_of(job);
  const auto seen = [](double a, double r) { return 1 - std::asin(a / r) / std::numbers::pi; };
  const int middle = g.voxels / 2;
  for (const int z : {0, 1, 68, 69}) {
    EXPECT_EQ(dose.values[dose.at(z, middle, middle)] == 0, z == 1 || z == 68);
    for (const int r : {15, 20, 35}) {
      const std::size_t at = dose.at(z, middle, middle + r);
      const double share = dose.values[at] / free.values[at];
      if (z == 0 || z == 69) {
        EXPECT_EQ(share, 1);
        continue;
      }
      // Squares whose middles are in the disc reach up to 0.71 voxels out of it or leave as much; a
      // ray more or less at either side.
      EXPECT_LE(share, seen(radius - 0.071, 0.1 * r) + 1.0 / angles);
      EXPECT_GE(share, seen(radius + 0.071, 0.1 * r) - 1.0 / angles);
    }
  }
}

class TomoInsertMeshes : public ::testing::Test {
 protected:
  Box<std::uint8_t> cut(const Point3& low, const Point3& high) const {
    return voxelise_insert(box_mesh(low, high), frame_, part_, printer_, 0.25);
  }
  std::string refused(const Point3& low, const Point3& high) const {
    try {
      cut(low, high);
    } catch (const InputError& e) {
      return e.what();
    }
    return "taken";
  }
  /// The axis is at (16, 17), where voxel 16, 16 lies.
  const TriangleMesh mesh_ = box_mesh({15, 16, 0}, {17, 18, 1});
  const Printer printer_ = bench_printer();
  const Box<std::uint8_t> part_ = voxelise(mesh_, printer_, 0.25);
  const PartFrame frame_ = frame_of(mesh_);
};

TEST_F(TomoInsertMeshes, KeepTheirPlaceBesideThePart) {
  EXPECT_EQ(part_.nz, 4);
  EXPECT_EQ(frame_.axis_x_mm, 16);
  EXPECT_EQ(frame_.axis_y_mm, 17);
  // Voxel i lies about 16 + 0.25 (i - 16), slice z about 0.125 + 0.25 z.
  struct Case {
    double low_mm, high_mm;
    int first, past;
  };
  for (const Case& c : {Case{-0.6, 0.5, 0, 2}, Case{0.3, 7, 1, 4}, Case{-3, 3, 0, 4},
                        Case{0.2, 0.7, 1, 3}, Case{-0.1, 0.1, 0, 0}}) {
    if (c.first == c.past) {
      EXPECT_THAT(refused({17.125, 16.875, c.low_mm}, {17.625, 17.375, c.high_mm}),
                  HasSubstr("from z = -0.100 to 0.100 mm, the part from 0.000 to 1.000"));
      continue;
    }
    const Box<std::uint8_t> insert = cut({17.125, 16.875, c.low_mm}, {17.625, 17.375, c.high_mm});
    ASSERT_EQ(insert.values.size(), part_.values.size());
    for (int z = 0; z < 4; ++z) {
      for (int y = 0; y < 33; ++y) {
        for (int x = 0; x < 33; ++x) {
          const bool in =
              z >= c.first && z < c.past && (x == 21 || x == 22) && (y == 16 || y == 17);
          EXPECT_EQ(insert.values[insert.at(z, y, x)], in ? 255 : 0) << x << ' ' << y << ' ' << z;
        }
      }
    }
  }
}

TEST_F(TomoInsertMeshes, WhereTheyOnlyTouchThePartHasTheVoxel) {
  // The part fills voxels 13 to 19, and half of 12 and 20.
  const int row = 17;
  Box<std::uint8_t> insert = cut({16.775, 16.5, 0}, {18, 17.5, 1});
  EXPECT_EQ(insert.values[insert.at(1, row, 19)], 0);  // 0.1 of its 0.25 mm
  EXPECT_GT(insert.values[insert.at(1, row, 20)], 0);
  insert = cut({16.7, 16.5, 0}, {18, 17.5, 1});
  EXPECT_GT(insert.values[insert.at(1, row, 19)], 0);
  PrintOptions options;
  options.insert = insert;
  try {
    solve_print(part_, 0.25, printer_, bench_resin(), options);
    FAIL();
  } catch (const InputError& e) {
    EXPECT_THAT(e.what(), testing::AllOf(HasSubstr("slice 0"), HasSubstr("voxel 19, 15"),
                                         HasSubstr("part and insert at once")));
  }
}

TEST_F(TomoInsertMeshes, OutsideOfTheVialTheyAreRefused) {
  EXPECT_THAT(refused({19.5, 16, 0}, {20.5, 18, 1}),
              testing::AllOf(HasSubstr("mm from the axis"), HasSubstr("x = 4.250"),
                             HasSubstr("in slice 0"), HasSubstr("the resin ends at 4 mm")));
  // Beside the part's slices it may be as wide as it likes.
  TriangleMesh wide = box_mesh({17.125, 16.875, 0}, {17.625, 17.375, 2});
  append(wide, box_mesh({0, 0, 2}, {30, 30, 3}));
  EXPECT_EQ(voxelise_insert(wide, frame_, part_, printer_, 0.25).values,
            cut({17.125, 16.875, 0}, {17.625, 17.375, 1}).values);
  EXPECT_THAT(refused({-1e5, 16, 0}, {1e5, 18, 1}), HasSubstr("inside the vial"));
  EXPECT_THAT(refused({16, 17, 2}, {17, 18, 3}), HasSubstr("beside it"));
}

TEST(TomoInserts, OfOtherSizesOrOutsideOfTheVialAreRefused) {
  const Printer printer = bench_printer();
  Box<std::uint8_t> part{1, 33, 33, std::vector<std::uint8_t>(33 * 33)};
  part.values[part.at(0, 16, 10)] = 255;
  const auto refused = [&](const Box<std::uint8_t>& insert) {
    PrintOptions options;
    options.insert = insert;
    try {
      solve_print(part, 0.25, printer, bench_resin(), options);
    } catch (const InputError& e) {
      return std::string(e.what());
    }
    return std::string("taken");
  };
  EXPECT_THAT(refused({1, 31, 33, std::vector<std::uint8_t>(31 * 33)}),
              HasSubstr("the insert has 33 x 31 x 1 voxels, the part 33 x 33 x 1"));
  Box<std::uint8_t> corner{1, 33, 33, std::vector<std::uint8_t>(33 * 33)};
  corner.values[0] = 1;
  EXPECT_THAT(refused(corner), HasSubstr("the insert reaches 5.657 mm from the axis"));
}

TEST(TomoBench, WhatCanNotBeIsRefused) {
  const auto refused = [](const Printer& printer, const Resin& resin, const Sampling& sampling) {
    try {
      make_bench(printer, resin, sampling);
    } catch (const InputError& e) {
      return std::string(e.what());
    }
    return std::string("taken");
  };
  const Sampling good{0.25, 3, 90};
  EXPECT_EQ(refused(bench_printer(), bench_resin(), good), "taken");
  Printer p = bench_printer();
  p.vial.reset();
  EXPECT_THAT(refused(p, bench_resin(), good), HasSubstr("vial"));
  Resin r = bench_resin();
  r.n = 0;
  EXPECT_THAT(refused(bench_printer(), r, good), HasSubstr("n"));
  EXPECT_THAT(refused(bench_printer(), bench_resin(), {0.2, 3, 90}), HasSubstr("0.25 mm"));
  EXPECT_THAT(refused(bench_printer(), bench_resin(), {9, 3, 90}), HasSubstr("voxels of 9 mm"));
  EXPECT_THAT(refused(bench_printer(), bench_resin(), {0.25, 3, 2}), HasSubstr("at least 3"));
  EXPECT_THAT(refused(bench_printer(), bench_resin(), {0.25, 3, 1000}), HasSubstr("864 frames"));
  EXPECT_THAT(refused(bench_printer(), bench_resin(), {0.25, 41, 90}), HasSubstr("10 mm high"));
}

class TomoJobs : public ::testing::Test {
 protected:
  std::string path(const std::string& name) const { return folder_ / name; }
  std::string refused(const std::string& file) const {
    try {
      read_job(file);
    } catch (const InputError& e) {
      return e.what();
    }
    return "taken";
  }
  test::TemporaryFolder folder_;
};

TEST_F(TomoJobs, WhatIsWrittenIsReadBack) {
  for (const Printer& printer : {bench_printer(), dry_printer()}) {
    const TomoJob job = random_job(printer, 5, 24);
    write_job(path("a.frames"), job);
    write_job(path("b.frames"), job);
    EXPECT_EQ(test::read_file(path("a.frames")), test::read_file(path("b.frames")));
    const TomoJob again = read_job(path("a.frames"));
    EXPECT_EQ(again.levels, job.levels);
    EXPECT_EQ(again.part.values, job.part.values);
    EXPECT_EQ(again.printer, job.printer);
    EXPECT_EQ(again.resin, job.resin);
    EXPECT_EQ(again.turns, job.turns);
  }
}

TEST_F(TomoJobs, HowTheSolveWentIsKept) {
  TomoJob job = random_job(bench_printer(), 5, 24);
  job.contrast_bound = 1.25;
  job.history = {
      {.rung = 0.98, .step = 0, .loss = 3.5, .ver = 0.25, .pw = -0.5, .contrast = 0.5},
      {.rung = 0.98, .step = 1, .pw = 1, .contrast = std::numeric_limits<double>::infinity()}};
  write_job(path("a.frames"), job);
  const TomoJob again = read_job(path("a.frames"));
  EXPECT_EQ(again.contrast_bound, 1.25);
  ASSERT_EQ(again.history.size(), 2U);
  for (std::size_t i = 0; i < 2; ++i) {
    const Step &a = again.history[i], &b = job.history[i];
    EXPECT_EQ(std::tuple(a.rung, a.step, a.loss, a.ver, a.pw, a.contrast),
              std::tuple(b.rung, b.step, b.loss, b.ver, b.pw, b.contrast));
  }
  // Jobs without it are jobs all the same.
  write_job(path("b.frames"), random_job(bench_printer(), 5, 24));
  EXPECT_TRUE(read_job(path("b.frames")).history.empty());
  EXPECT_TRUE(std::isinf(read_job(path("b.frames")).contrast_bound));
  job.history[1].ver = 2;
  write_job(path("a.frames"), job);
  EXPECT_THAT(refused(path("a.frames")), HasSubstr("history[1].ver is 2"));
}

TEST_F(TomoJobs, InsertsAreReadBack) {
  TomoJob job = random_job(bench_printer(), 5, 24);
  write_job(path("none.frames"), job);
  EXPECT_TRUE(read_job(path("none.frames")).insert.values.empty());
  job.insert = job.part;
  for (std::uint8_t& v : job.insert.values) v = v == 0 ? 7 : 0;
  write_job(path("a.frames"), job);
  EXPECT_EQ(read_job(path("a.frames")).insert.values, job.insert.values);
  job.insert.nz = 4;
  EXPECT_THROW(write_job(path("b.frames"), job), InputError);
}

TEST_F(TomoJobs, DamageIsRefusedByName) {
  test::write_file(path("text.frames"), test::to_bytes("no archive at all, but text"));
  EXPECT_THAT(refused(path("text.frames")), HasSubstr("text.frames"));
  EXPECT_THAT(refused(path("none.frames")), HasSubstr("none.frames"));
}

TEST(TomoPrint, ASquareIsPrintedAsDesigned) {
  const Printer printer = bench_printer();
  Box<std::uint8_t> part{2, 33, 33, std::vector<std::uint8_t>(2 * 33 * 33)};
  for (int z = 0; z < 2; ++z) {
    for (int y = 10; y < 23; ++y) {
      for (int x = 10; x < 23; ++x) part.values[part.at(z, y, x)] = 255;
    }
  }
  PrintOptions options;
  options.angles = 60;
  options.solve.rungs = {0.98, 0.9};
  const Print print = solve_print(part, 0.25, printer, bench_resin(), options);
  const PrintFigures& f = print.figures;
  EXPECT_TRUE(f.feasible()) << f.fault();
  EXPECT_EQ(f.metrics.void_gelled, 0U);
  EXPECT_EQ(f.jaccard_at_dose, 1.0);
  // The same light for ten times as long: all of the part gels before any void, and void gels.
  TomoJob longer = print.job;
  longer.turns *= 10;
  const PrintFigures over = figures_of(longer, dose_of(longer), part);
  EXPECT_EQ(over.metrics.void_gelled, 0U);
  EXPECT_GT(over.metrics.max_void, over.gel_dose_mj_cm3);
  EXPECT_LT(over.jaccard_at_dose, 1);
  EXPECT_FALSE(over.feasible());
  EXPECT_THAT(std::string(over.fault()), HasSubstr("shown for too long"));
  EXPECT_GE(f.metrics.min_gel, f.gel_dose_mj_cm3);
  EXPECT_GE(f.metrics.contrast, 1 / 0.98 * 0.99);
  EXPECT_LE(f.metrics.contrast, f.contrast_bound);
  EXPECT_NEAR(f.print_time_s, f.turns * 14.4, 1e-9);
  EXPECT_LT(f.floor_mj_cm3, 0.1 * f.gel_dose_mj_cm3);
  // One turn less would be too few, even at full light: levels reach near the brightest.
  std::uint16_t brightest = 0;
  for (const std::uint16_t level : print.job.levels) brightest = std::max(brightest, level);
  EXPECT_GT(brightest, 255 * (f.turns - 1) / f.turns - 2);

  options.most_time_s = 1;
  EXPECT_THROW(solve_print(part, 0.25, printer, bench_resin(), options), InfeasibleError);
  options.most_time_s = 0;
}

/// Contrast costs light: with a time that is fixed, the ladder finds light that needs less.
TEST(TomoPrint, LightIsKeptWithinTheTimeThatIsAllowed) {
  Resin slow = bench_resin();
  slow.critical_dose_mj_cm3 = 2000;
  PrintOptions options;
  options.angles = 60;
  const Print free = solve_print(square_part(), 0.25, bench_printer(), slow, options);
  ASSERT_TRUE(free.figures.feasible());
  options.most_time_s = 0.5 * free.figures.print_time_s;
  const Print quick = solve_print(square_part(), 0.25, bench_printer(), slow, options);
  EXPECT_TRUE(quick.figures.feasible());
  EXPECT_LE(quick.figures.print_time_s, options.most_time_s);
  EXPECT_GT(quick.figures.efficiency, 1.5 * free.figures.efficiency);
  EXPECT_LT(quick.figures.metrics.contrast, free.figures.metrics.contrast);
  // All pixels at their brightest would not do in a hundredth.
  options.most_time_s = 0.01 * free.figures.print_time_s;
  try {
    solve_print(square_part(), 0.25, bench_printer(), slow, options);
    FAIL();
  } catch (const InfeasibleError& e) {
    EXPECT_THAT(e.what(), testing::AllOf(HasSubstr("turns"), HasSubstr("longer than allowed")));
  }
}

/// Pixels much finer than voxels must not be used to meet the doses at the middles of voxels alone:
/// what lies between them has to print too. Doses there differ by what light that is linear over a
/// voxel may bend, in all by less than a quarter.
TEST(TomoPrint, BetweenTheMiddlesOfVoxelsItPrintsToo) {
  for (const Printer& like : {bench_printer(), dry_printer()}) {
    Printer fine = like;
    fine.pixel_x_um = fine.pixel_y_um = 60;
    fine.width_px = 200;
    fine.optics->axis_up_px = 0;
    PrintOptions options;
    options.angles = 90;
    options.solve.rungs = {0.98, 0.9, 0.8, 0.7};
    Box<std::uint8_t> part{1, 33, 33, std::vector<std::uint8_t>(33 * 33)};
    for (int y = 12; y < 21; ++y) {
      for (int x = 12; x < 21; ++x) part.values[part.at(0, y, x)] = 255;
    }
    const Print print = solve_print(part, 0.25, fine, bench_resin(1), options);
    EXPECT_TRUE(print.figures.feasible());
    // The same light on voxels of a third of the size.
    const Bench bench = make_bench(fine, print.job.resin, print.job.sampling);
    TomoJob thirds = print.job;
    thirds.sampling.voxel_mm /= 3;
    const Bench finer = make_bench(fine, thirds.resin, thirds.sampling);
    const TomoGrid &from = bench.grid, &to = finer.grid;
    thirds.levels.assign(to.blocks() * to.light_of_block(), 0);
    for (int m = 0; m < to.angles; ++m) {
      for (int i = 0; i < to.pixels; ++i) {
        const int column = finer.window.first_column + i - bench.window.first_column;
        if (column < 0 || column >= from.pixels) continue;
        thirds.levels[to.pixel(m, i, 0)] = print.job.levels[from.pixel(m, column, 0)];
      }
    }
    const Box<float> dose = dose_of(thirds);
    double least = 1e9, most = 0;
    for (int y = -60; y <= 60; ++y) {
      for (int x = -60; x <= 60; ++x) {
        // Whole voxels of 3 x 3 thirds, out to where the part may reach.
        const int vx = static_cast<int>(std::lround(x / 3.0)),
                  vy = static_cast<int>(std::lround(y / 3.0));
        if (std::hypot(vx, vy) > 10) continue;
        const double d = dose.values[dose.at(0, dose.ny / 2 + y, dose.nx / 2 + x)];
        if (part.values[part.at(0, 16 + vy, 16 + vx)] == 255) {
          least = std::min(least, d);
        } else {
          most = std::max(most, d);
        }
      }
    }
    EXPECT_GT(least, 0.75 * print.figures.metrics.min_gel);
    EXPECT_LT(most, 1.25 * print.figures.gel_dose_mj_cm3);
  }
}

TEST(TomoPrint, TooFewAnglesAreTold) {
  std::string told;
  ExecutionContext context;
  context.notice = [&](const std::string& text) { told += text + "\n"; };
  PrintOptions options;
  options.solve.method = Method::fbp;
  options.angles = 40;
  // The corners lie 6 sqrt 2 voxels from the axis: 2 pi times that is 53.3.
  solve_print(square_part(), 0.25, bench_printer(), bench_resin(), options, context);
  EXPECT_THAT(told, HasSubstr("40 angles are too few for voxels of 0.25 mm at 2.12 mm from the "
                              "axis: 54 would resolve them\n"));
  told.clear();
  Printer quick = bench_printer();
  quick.rotation->max_fps = 45 / quick.rotation->turn_s();
  solve_print(square_part(), 0.25, quick, bench_resin(), options, context);
  EXPECT_THAT(told, HasSubstr("54 would resolve them, of which the projector shows 45 in a turn"));
  told.clear();
  options.angles = 54;
  solve_print(square_part(), 0.25, bench_printer(), bench_resin(), options, context);
  EXPECT_THAT(told, testing::Not(HasSubstr("too few")));
}

/// With few levels the better way to round is taken: never worse than the nearest level.
TEST(TomoPrint, FewLevelsAreRoundedTheBetterWay) {
  Printer four = bench_printer();
  four.bit_depth = 4;
  four.calibration = {{0, 0.002}, {15, 2.0}};
  PrintOptions options;
  options.angles = 60;
  options.solve.rungs = {0.9, 0.7};
  const Print print = solve_print(square_part(), 0.25, four, bench_resin(), options);
  EXPECT_TRUE(print.figures.feasible());
  const Print fine = solve_print(square_part(), 0.25, bench_printer(), bench_resin(), options);
  EXPECT_GT(fine.figures.metrics.contrast, print.figures.metrics.contrast);
}

/// Each angle's frame shown three times is that frame: doses are the same, level and from a point.
TEST(TomoPrint, HeldFramesBringTheSameDose) {
  for (const bool point : {false, true}) {
    Printer printer = bench_printer();
    if (point) {
      printer.optics->kind = OpticsKind::pinhole;
      printer.optics->distance_mm = 60;
    }
    TomoJob once;
    once.printer = printer;
    once.resin = bench_resin();
    once.sampling = {0.25, 2, 30};
    TomoJob held = once;
    held.sampling.angles = 90;
    const TomoGrid a = make_bench(printer, once.resin, once.sampling).grid,
                   b = make_bench(printer, once.resin, held.sampling).grid;
    once.levels.assign(a.blocks() * a.light_of_block(), 0);
    held.levels.assign(b.blocks() * b.light_of_block(), 0);
    std::mt19937 random(3);
    for (int m = 0; m < 30; ++m) {
      for (int i = 0; i < a.pixels; ++i) {
        for (int r = 0; r < a.light_rows(); ++r) {
          const auto level = static_cast<std::uint16_t>(random() % 256);
          once.levels[a.pixel(m, i, r)] = level;
          for (int k = -1; k <= 1; ++k) held.levels[b.pixel((3 * m + k + 90) % 90, i, r)] = level;
        }
      }
    }
    const Box<float> one = dose_of(once), three = dose_of(held);
    double squares = 0, sum = 0, sum_held = 0;
    for (std::size_t i = 0; i < one.values.size(); ++i) {
      squares += std::pow(one.values[i] - three.values[i], 2);
      sum += one.values[i];
      sum_held += three.values[i];
    }
    // A weight is right to 1 % of the largest; steps are cut into other cells, each with its own errors.
    EXPECT_LT(std::sqrt(squares / static_cast<double>(one.values.size())), 0.01 * largest(one));
    EXPECT_NEAR(sum_held / sum, 1, 0.002);
  }
}

/// A projector thirty times as bright shows a few levels: frames that are held have contrast that they lose.
TEST(TomoPrint, HeldFramesMakeUpForFewLevels) {
  Printer bright = bench_printer();
  bright.calibration = {{0, 0.002}, {255, 120.0}};
  PrintOptions options;
  options.angles = 60;
  options.solve.rungs = {0.9, 0.7};
  const auto contrast = [&](const Printer& printer, int hold) {
    options.hold = hold;
    const Print print = solve_print(square_part(), 0.25, printer, bench_resin(), options);
    EXPECT_EQ(print.job.sampling.angles, 60 * std::max(1, hold));
    EXPECT_TRUE(print.figures.feasible());
    return print.figures.metrics.contrast;
  };
  const double fine = contrast(bench_printer(), 1), once = contrast(bright, 1),
               held = contrast(bright, 9);
  EXPECT_LT(once, 0.98 * fine);
  EXPECT_GT(held, once + 0.5 * (fine - once));
  // Where the number of angles is free, frames are held unasked.
  options.angles = options.hold = 0;
  std::string told;
  ExecutionContext context;
  context.notice = [&](std::string_view text) { told += std::string(text) + "\n"; };
  const Print print = solve_print(square_part(), 0.25, bright, bench_resin(), options, context);
  EXPECT_THAT(told, HasSubstr("is held as"));
  EXPECT_EQ(print.job.sampling.angles % 3, 0);
}

TEST(TomoPrint, FramesThatCanNotBeHeldAreRefused) {
  const auto refused = [](Printer printer, int hold, const std::string& text) {
    PrintOptions options;
    options.angles = 60;
    options.hold = hold;
    try {
      check_print(square_part(), 0.25, printer, bench_resin(), options);
      ADD_FAILURE() << text;
    } catch (const InputError& e) {
      EXPECT_THAT(e.what(), HasSubstr(text));
    }
  };
  refused(bench_printer(), 4, "expected an odd number");
  refused(bench_printer(), 15, "expected at most 864 in a turn");
  Printer wobbling = bench_printer();
  wobbling.rotation->wobble = {{0, 0.5, 0}, {180, -0.5, 0}};
  refused(wobbling, 3, "wobbles");
}

TEST(TomoPrint, WhatCanNotBePrintedIsToldByName) {
  const auto told = [](const Box<std::uint8_t>& part, const Printer& printer, const Resin& resin,
                       const char* kind) {
    PrintOptions options;
    options.angles = 60;
    try {
      solve_print(part, 0.25, printer, resin, options);
    } catch (const InputError& e) {
      EXPECT_STREQ(kind, "input");
      return std::string(e.what());
    } catch (const InfeasibleError& e) {
      EXPECT_STREQ(kind, "infeasible");
      return std::string(e.what());
    }
    return std::string("taken");
  };
  Box<std::uint8_t> empty = square_part(), full = square_part(), grey = square_part();
  for (std::uint8_t& v : empty.values) v = 0;
  for (std::uint8_t& v : grey.values) v = v == 0 ? 0 : 254;
  for (int y = 0; y < 33; ++y) {
    for (int x = 0; x < 33; ++x) {
      full.values[full.at(0, y, x)] = std::hypot(x - 16, y - 16) < 16.01 ? 255 : 0;
    }
  }
  const Printer printer = bench_printer();
  const Resin resin = bench_resin();
  EXPECT_THAT(told(empty, printer, resin, "input"),
              HasSubstr("no voxel inside the vial is wholly part"));
  EXPECT_THAT(told(grey, printer, resin, "input"), HasSubstr("use smaller voxels"));
  EXPECT_THAT(told(full, printer, resin, "input"),
              HasSubstr("no voxel inside the vial is wholly empty"));
  // At alpha R 3 the middle of a square is too dark for any light.
  EXPECT_THAT(told(square_part(), printer, bench_resin(7.5), "infeasible"),
              testing::AllOf(HasSubstr("no light prints this part"),
                             HasSubstr("in slice 0 (0.000 mm"), HasSubstr("alpha R is 3")));
  // Black light that is a quarter of the brightest: even so little from all sides gels void.
  Printer bright = printer;
  bright.calibration = {{0, 0.5}, {255, 2.0}};
  EXPECT_THAT(told(square_part(), bright, resin, "infeasible"),
              testing::AllOf(HasSubstr("black light alone gels void"), HasSubstr("of 20")));
  Printer flat = printer;
  flat.calibration = {{0, 1.0}, {255, 1.0}};
  EXPECT_THAT(told(square_part(), flat, resin, "input"),
              HasSubstr("its brightest level shows 1 mW/cm², its darkest 1; expected a calibration "
                        "that rises"));
}

TEST(TomoPrint, PartsBeyondTheReachAreRefused) {
  Box<std::uint8_t> part{1, 33, 33, std::vector<std::uint8_t>(33 * 33)};
  part.values[part.at(0, 16, 2)] = 255;  // a dry vial of 4.5 mm is reached up to 4.5 / 1.5
  try {
    solve_print(part, 0.25, dry_printer(), bench_resin());
    FAIL();
  } catch (const InputError& e) {
    EXPECT_THAT(e.what(), testing::AllOf(HasSubstr("3.500 mm from the axis"), HasSubstr("3.000 mm"),
                                         HasSubstr("scaled by at most")));
  }
  Box<std::uint8_t> outside{1, 41, 41, std::vector<std::uint8_t>(41 * 41)};
  outside.values[0] = 255;
  EXPECT_THROW(placed(outside, bench_printer(), 0.25), InputError);
  // A mesh that is wider than the resin; in its corners alone, it fits the square around it.
  for (const double half_mm : {5.0, 3.9}) {
    try {
      voxelise(box_mesh({0, 0, 0}, {2 * half_mm, 2 * half_mm, 1}), bench_printer(), 0.25);
      FAIL();
    } catch (const InputError& e) {
      EXPECT_THAT(e.what(),
                  HasSubstr(half_mm == 5 ? "7.071 mm from the axis, the resin ends at 4 mm; "
                                           "expected a part scaled by at most 0.5656"
                                         : "5.515 mm from the axis"));
    }
  }
}

}  // namespace
}  // namespace slicecorr::tomo
