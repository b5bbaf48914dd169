// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Vials that are not round, and rods in the resin: operators and judge against rays that are marched at random
// through regions which are known by a distance function alone, with normals from its differences and Snell's law in
// vectors; and against closed forms, where a vial is a round one in disguise.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>
#include <vector>

#include "slicecorr/error.hpp"
#include "slicecorr/tomo/print.hpp"
#include "slicecorr/tomo/report.hpp"
#include "slicecorr/tomo/section.hpp"
#include "slicecorr/vial.hpp"
#include "slicecorr/vial_outline.hpp"
#include "tomo_jobs.hpp"
#include "tomo_pair.hpp"
#include "tomo_regions.hpp"
#include "tomo_walk.hpp"

namespace slicecorr::tomo::traced_test {
namespace {

TEST(TomoTraced, RaysAgreeInASquareVial) {
  const Regions regions{rounded(2, 2, 0), rounded(1.7, 1.7, 0), {}};
  expect_march_agrees(regions, square_printer(0, 1));
}
TEST(TomoTraced, RaysAgreeInASquareVialWithRoundCorners) {
  const Regions regions{rounded(2, 2, 0.8), rounded(1.7, 1.7, 0.5), {}};
  expect_march_agrees(regions, square_printer(0.8, 1.33), {{0.25, 2, 12}});
}
TEST(TomoTraced, RaysAgreeInAnOutline) {
  Printer p = square_printer(0, 1);
  p.vial->shape = VialShape::outline;
  for (int k = 5; k >= 0; --k) {  // clockwise is taken, too
    const double at = pi / 3 * (k + 0.5) + 0.1, r = 2.2 / std::cos(pi / 6);
    p.vial->outline.push_back({r * std::cos(at), r * std::sin(at)});
  }
  ASSERT_FALSE(wrong_outline(*p.vial));
  set_radii(*p.vial);
  expect_march_agrees({hexagon(2.2), hexagon(1.9), {}}, p);
}
TEST(TomoTraced, RaysAgreeAroundAGlassRod) {
  for (const double n : {1.62, 1.33}) {
    Printer p = small_printer(true, 0.25);
    p.vial->rods = {{0.6, -0.3, 1.2, n}};
    expect_march_agrees({disc(0, 0, 2.25), disc(0, 0, 2), {{disc(0.6, -0.3, 0.6), n, 0}}}, p);
  }
}
TEST(TomoTraced, RaysAgreeAroundAMetalRod) {
  Printer p = square_printer(0, 1.5);
  p.vial->rods = {{0.4, 0.5, 1, 0, 0.8}, {-0.9, -0.6, 0.5, 0, 0}};
  expect_march_agrees({rounded(2, 2, 0),
                       rounded(1.7, 1.7, 0),
                       {{disc(0.4, 0.5, 0.5), 0, 0.8}, {disc(-0.9, -0.6, 0.25), 0, 0}}},
                      p);
}

/// Light at random through two benches of the same vial.
void expect_same(const Printer& one, const Printer& other, double allowed) {
  const Bench a = make_bench(one, bench_resin(), {0.25, 3, 30}),
              b = make_bench(other, bench_resin(), {0.25, 3, 30});
  ASSERT_EQ(a.grid.voxels, b.grid.voxels);
  // By columns of the image: benches differ in which of them they keep.
  const auto dose_of = [](const Bench& bench) {
    Light light(bench.grid);
    for (int m = 0; m < bench.grid.angles; ++m) {
      for (int i = 0; i < bench.grid.pixels; ++i) {
        const auto column = static_cast<unsigned>(bench.window.first_column + i);
        std::mt19937 random(1000U * static_cast<unsigned>(m) + column);
        for (int z = 0; z < bench.grid.slices; ++z) {
          light.values[bench.grid.pixel(m, i, z)] = static_cast<float>(random() % 1000) * 1e-3F;
        }
      }
    }
    return adjoint(*make_projector(bench), {}, light);
  };
  const Field want = dose_of(a), got = dose_of(b);
  const double most = *std::max_element(want.values.begin(), want.values.end());
  int all = 0;
  for (int y = 0; y < a.grid.voxels; ++y) {
    for (int x = 0; x < a.grid.voxels; ++x) {
      if (std::hypot(a.grid.voxel_at_mm(x), a.grid.voxel_at_mm(y)) > 0.6 * a.grid.radius_mm)
        continue;
      ++all;
      const std::size_t v = a.grid.voxel(x, y, 1);
      EXPECT_NEAR(got.values[v], want.values[v], allowed * most) << x << " " << y;
    }
  }
  EXPECT_GT(all, 50);
}

/// A round vial as an outline of 90 corners, dry; and with a rod of the resin's index. Closed forms are right to 1 %
/// of large weights.
TEST(TomoTraced, RoundVialsInDisguise) {
  Printer round = small_printer(true, 0.25), outline = round;
  outline.vial->shape = VialShape::outline;
  outline.vial->wall_mm = 0.25;
  for (int k = 0; k < 90; ++k) {
    outline.vial->outline.push_back({2.25 * std::cos(pi * k / 45), 2.25 * std::sin(pi * k / 45)});
  }
  outline.vial->outer_mm = 2.25;
  outline.vial->inner_mm = 2;
  expect_same(round, outline, 0.01);
  Printer rod = round;
  rod.vial->rods = {{5e-4, 0, 1e-3, 1.5}};
  expect_same(round, rod, 0.01);
}

TEST(TomoTraced, OperatorsAreTransposesForAnyNumberOfThreads) {
  Printer p = square_printer(0.5, 1);
  p.vial->rods = {{0.4, 0.5, 0.8, 1.7, 0}};
  p.height_px = 40;
  for (const int slices : {1, 5, 20}) {
    const Bench bench = make_bench(p, bench_resin(), {0.25, slices, 16});
    SCOPED_TRACE(slices);
    const auto projector = make_projector(bench);
    const RandomPair random(bench.grid);
    expect_transposes(*projector, random);
    expect_same_for_any_threads(*projector, *make_projector(bench), random);
  }
}

/// Behind a wall of air in a bath light at 45 degrees is reflected as a whole: sin 45 > 1/1.5.
TEST(TomoTraced, CornersThatReflectAllLightAreDark) {
  Printer p = square_printer(0, 1.5);
  p.vial->n_wall = 1;
  const Bench bench = make_bench(p, bench_resin(), {0.25, 1, 8});
  const TomoGrid& g = bench.grid;
  const auto dose_of_frame = [&](int m) {
    Light light(g);
    for (int i = 0; i < g.pixels; ++i) light.values[g.pixel(m, i, 0)] = 1;
    const Field field = adjoint(*make_projector(bench), {}, light);
    return field.values[g.voxel(g.voxels / 2, g.voxels / 2, 0)];
  };
  // A step of 45 degrees goes to 22.5 to both sides: a frame at 45 begins at 22.5, where light comes in still.
  EXPECT_GT(dose_of_frame(0), 0.5);
  Printer thin = p;
  const Bench fine = make_bench(thin, bench_resin(), {0.25, 1, 72});
  Light light(fine.grid);
  for (int i = 0; i < fine.grid.pixels; ++i) light.values[fine.grid.pixel(9, i, 0)] = 1;
  const Field dark = adjoint(*make_projector(fine), {}, light);
  EXPECT_EQ(*std::max_element(dark.values.begin(), dark.values.end()), 0);
}

/// A ring around a rod of glass in a dry square vial: frames that are found for it print it. Frames for a vial in a
/// bath, whose walls bend nothing, do not.
TEST(TomoTraced, SolvingCountsIt) {
  Printer p = square_printer(0, 1);
  p.vial->rods = {{0, 0, 0.9, 1.62, 0}};
  const Resin resin = bench_resin(0.5);
  const int n = voxels_across(p, 0.25), c = n / 2;
  Box<std::uint8_t> part{1, n, n, std::vector<std::uint8_t>(static_cast<std::size_t>(n * n))};
  for (int y = -4; y <= 4; ++y) {
    for (int x = -4; x <= 4; ++x) {
      const double r = 0.25 * std::hypot(x, y);
      if (r > 0.6 && r < 1.05) part.values[part.at(0, c + y, c + x)] = 255;
    }
  }
  PrintOptions options;
  options.angles = 48;
  options.solve.method = Method::osmo;
  const Print counted = solve_print(part, 0.25, p, resin, options);
  Printer bath = p;
  bath.vial->rods.clear();
  bath.vial->n_outside = bath.vial->n_wall = 1.5;
  TomoJob naive = solve_print(part, 0.25, bath, resin, options).job;
  naive.printer = p;
  naive.insert = counted.job.insert;
  const PrintFigures of_naive = figures_of(naive, dose_of(naive), naive.part);
  EXPECT_GT(counted.figures.metrics.contrast, 1);
  EXPECT_LT(of_naive.metrics.contrast, 0.9 * counted.figures.metrics.contrast);
  RecordProperty("counted", std::to_string(counted.figures.metrics.contrast));
  RecordProperty("naive", std::to_string(of_naive.metrics.contrast));
  // Its page has what others have.
  const Box<float> dose = dose_of(counted.job);
  EXPECT_NE(report_page({counted.job, dose, counted.figures}, "a ring").find("a ring"),
            std::string::npos);
  // A section shows the rod, and what lies beyond the wall as no resin. The part is 9 voxels wide, the resin
  // 13 and the margin 2.
  const PrintSection cut = sections_of({counted.job, dose, counted.figures}, {{Axis::z, 0}})[0];
  EXPECT_EQ(std::count(cut.matter.begin(), cut.matter.end(), Matter::insert), 9);
  EXPECT_EQ(std::count(cut.matter.begin(), cut.matter.end(), Matter::nothing), 0);
  EXPECT_EQ(cut.width, 13);
  const PrintSection along = sections_of({counted.job, dose, counted.figures}, {{Axis::x, 1.7}})[0];
  EXPECT_EQ(std::count(along.matter.begin(), along.matter.end(), Matter::nothing),
            static_cast<std::ptrdiff_t>(along.matter.size()));
  // The rod is neither part nor void, resin beside it is.
  EXPECT_EQ(counted.job.insert.values[counted.job.insert.at(0, c, c)], 255);
  EXPECT_EQ(counted.job.insert.values[counted.job.insert.at(0, c, c + 3)], 0);
}

/// Two doses beside each other in a square vial: all within, as the judge's doses say by a count of their own; and
/// nothing is wanted in its wall.
TEST(TomoTraced, WantedDosesInASquareVial) {
  const Printer p = square_printer(0, 1);
  const int n = voxels_across(p, 0.25), c = n / 2;
  WantedValues v{
      {1, n, n, std::vector<float>(static_cast<std::size_t>(n * n))}, {1, 1, 1, {6}}, {}};
  for (int y = -3; y <= 3; ++y) {
    for (int x = -3; x <= 3; ++x) {
      v.wanted.values[v.wanted.at(0, c + y, c + x)] = x < 0 ? 36 : 30;
    }
  }
  const DoseBands wanted = wanted_doses(v, {}, 20);
  PrintOptions options;
  options.angles = 48;
  options.wanted = wanted;
  const Print print = solve_print(part_of(wanted, 20), 0.25, p, bench_resin(0.5), options);
  int within = 0, all = 0;
  const Box<float> dose = dose_of(print.job);
  for (int y = -6; y <= 6; ++y) {
    for (int x = -6; x <= 6; ++x) {
      const std::size_t i = dose.at(0, c + y, c + x);
      const float want = v.wanted.values[i], d = dose.values[i];
      ++all;
      within += want > 0 ? std::abs(d - want) <= 6 : d <= 20;
    }
  }
  ASSERT_TRUE(print.figures.wanted);
  EXPECT_EQ(print.figures.wanted->voxels, static_cast<std::size_t>(all));
  EXPECT_EQ(print.figures.wanted->within, static_cast<std::size_t>(within));
  EXPECT_GE(print.figures.wanted->slack, 1);
  RecordProperty("slack", std::to_string(print.figures.wanted->slack));
  // In the wall, too low to gel: it would have been left out.
  v.wanted.values[v.wanted.at(0, c, c + 7)] = 10;
  options.wanted = wanted_doses(v, {}, 20);
  EXPECT_THROW(solve_print(part_of(options.wanted, 20), 0.25, p, bench_resin(0.5), options),
               InputError);
  // And in the corner of a round vial's grid.
  Printer round = small_printer(true, 0.25);
  const int m = voxels_across(round, 0.25);
  WantedValues corner{
      {1, m, m, std::vector<float>(static_cast<std::size_t>(m * m))}, {1, 1, 1, {6}}, {}};
  corner.wanted.values[corner.wanted.at(0, m / 2, m / 2)] = 30;
  corner.wanted.values[0] = 10;
  options.wanted = wanted_doses(corner, {}, 20);
  EXPECT_THROW(solve_print(part_of(options.wanted, 20), 0.25, round, bench_resin(0.5), options),
               InputError);
}

TEST(TomoTraced, RefusesByName) {
  const auto words = [](const Printer& p, const Resin& resin) -> std::string {
    try {
      make_bench(p, resin, {0.25, 2, 12});
    } catch (const InputError& e) {
      return e.what();
    }
    return {};
  };
  const auto has = [](const std::string& text, const char* part) {
    return text.find(part) != std::string::npos;
  };
  Printer p = square_printer(0, 1);
  EXPECT_EQ(words(p, bench_resin()), "");
  Printer blurred = p;
  blurred.spread.gaussians = {{100, 1}};
  EXPECT_TRUE(has(words(blurred, bench_resin()), "expected a printer without spread"));
  Printer leaning = p;
  leaning.optics->tilt_deg = 2;
  EXPECT_TRUE(has(words(leaning, bench_resin()), "tilt_deg 0"));
  Resin back = bench_resin();
  back.inhibition_resupply_mj_cm3_s = 0.1;
  EXPECT_TRUE(has(words(p, back), "inhibition_resupply_mj_cm3_s"));
  EXPECT_THROW(reach_mm(p, 1.5), InputError);
  // A part in the wall.
  const int n = voxels_across(p, 0.25);
  Box<std::uint8_t> part{1, n, n, std::vector<std::uint8_t>(static_cast<std::size_t>(n * n))};
  part.values[part.at(0, n / 2, n / 2 + 7)] = 255;
  EXPECT_THROW(solve_print(part, 0.25, p, bench_resin()), InputError);
}

TEST(VialOutline, SaysWhatIsWrong) {
  Vial v;
  v.shape = VialShape::square;
  v.side_mm = 4;
  v.wall_mm = 2;
  EXPECT_EQ(std::string(wrong_outline(v)->key), "wall_mm");
  v.wall_mm = 0.5;
  EXPECT_FALSE(wrong_outline(v));
  v.corner_mm = 2;
  EXPECT_EQ(std::string(wrong_outline(v)->key), "corner_mm");
  v.corner_mm = 0;
  v.rods = {{1, 0, 1, 1.5, 0}};
  EXPECT_EQ(std::string(wrong_outline(v)->key), "glass_rods");
  v.rods = {{0.5, 0, 1, 0, 0.5}, {-0.4, 0, 1, 0, 0.5}};
  EXPECT_EQ(std::string(wrong_outline(v)->key), "metal_rods");
  v.rods.clear();
  v.shape = VialShape::outline;
  v.outline = {{-2, -2}, {2, -2}, {0, 0.5}, {2, 2}, {-2, 2}};
  EXPECT_EQ(std::string(wrong_outline(v)->key), "outline");  // a dent
  v.outline = {{1, 1}, {3, 1}, {3, 3}, {1, 3}};
  EXPECT_EQ(std::string(wrong_outline(v)->key), "outline");  // beside the axis
  v.outline = {{-2, -2}, {2, -2}};
  EXPECT_EQ(std::string(wrong_outline(v)->key), "outline");
  v.outline = {{-2, -2}, {2, -2}, {2, 2}, {2, 2}, {-2, 2}};
  EXPECT_EQ(std::string(wrong_outline(v)->key), "outline");  // twice
  v.outline = {{-2, -2}, {2, -2}, {2, 1.9}, {1.9, 2}, {-2, 2}};
  v.wall_mm = 1;
  EXPECT_EQ(std::string(wrong_outline(v)->key), "wall_mm");  // a side shorter than the wall takes
  v.wall_mm = 0.1;
  EXPECT_FALSE(wrong_outline(v));
  EXPECT_TRUE(ResinArea(v).has({1.85, 0}));
  EXPECT_FALSE(ResinArea(v).has({1.95, 0}));
  set_radii(v);
  EXPECT_NEAR(v.outer_mm, std::hypot(2, 2), 1e-12);
  EXPECT_NEAR(nearest_wall_mm(v), 1.9, 1e-12);
}

}  // namespace
}  // namespace slicecorr::tomo::traced_test
