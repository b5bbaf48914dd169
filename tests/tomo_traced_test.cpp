// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Vials that are not round, and rods in the resin: operators and judge against rays that are marched at random
// through regions which are known by a distance function alone, with normals from its differences and Snell's law in
// vectors; and against closed forms, where a vial is a round one in disguise.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <numbers>
#include <random>
#include <vector>

#include "slicecorr/error.hpp"
#include "slicecorr/tomo/print.hpp"
#include "slicecorr/tomo/report.hpp"
#include "slicecorr/tomo/section.hpp"
#include "slicecorr/vial.hpp"
#include "slicecorr/vial_outline.hpp"
#include "snell.hpp"
#include "tomo_jobs.hpp"
#include "tomo_walk.hpp"

namespace slicecorr::tomo::traced_test {
namespace {

/// Below 0 within, mm or nearly.
using Region = std::function<double(double, double)>;
struct Body {
  Region within;
  double n = 1, reflects = 0;
};
/// A vial as its regions: the wall's outside, resin, and rods in it.
struct Regions {
  Region outer, inner;
  std::vector<Body> rods;
};

Region rounded(double half_x, double half_y, double radius) {
  return [=](double x, double y) {
    const double a = std::abs(x) - (half_x - radius), b = std::abs(y) - (half_y - radius);
    return std::hypot(std::max(a, 0.0), std::max(b, 0.0)) + std::min(std::max(a, b), 0.0) - radius;
  };
}
Region hexagon(double apothem) {
  std::vector<std::pair<double, double>> sides;
  for (int k = 0; k < 6; ++k) {
    sides.emplace_back(std::cos(pi / 3 * k + 0.1), std::sin(pi / 3 * k + 0.1));
  }
  return [=](double x, double y) {
    double most = -1e9;
    for (const auto& [c, s] : sides) most = std::max(most, x * c + y * s - apothem);
    return most;
  };
}
Region disc(double x0, double y0, double radius) {
  return [=](double x, double y) { return std::hypot(x - x0, y - y0) - radius; };
}

/// What a ray leaves, marched by small steps in the frame of the part: calls use(x, y, power, way) at places every
/// `step` of the resin.
class Marcher {
 public:
  Marcher(const Regions& regions, const Vial& vial, double n_resin)
      : r_(regions), vial_(vial), n_(n_resin) {}

  template <class Use>
  void march(test::Vector at, test::Vector along, double step, const Use& use) const {
    double s = 1, p = 1;
    if (!to(
            at, along, [&](double x, double y) { return r_.outer(x, y); }, true))
      return;
    if (!bend(at, along, r_.outer, 1, vial_.n_outside, vial_.n_wall, s, p)) return;
    if (!to(
            at, along, [&](double x, double y) { return std::max(r_.outer(x, y) - 1e-7, -1e9); },
            false, &r_.inner)) {
      return;
    }
    if (!bend(at, along, r_.inner, 1, vial_.n_wall, n_, s, p)) return;
    double way = 0;
    bool mirrored = false;
    for (double until = step * offset_;;) {
      const double next = std::min(until, kMarch);
      test::Vector there = test::add(at, along, next);
      if (r_.inner(there[0], there[1]) > 0) return;
      const Body* met = nullptr;
      for (const Body& rod : r_.rods) {
        if (rod.within(there[0], there[1]) < 0) met = &rod;
      }
      if (met != nullptr) {
        // Back to its face.
        double low = 0, high = next;
        for (int k = 0; k < 50; ++k) {
          const double middle = (low + high) / 2;
          const test::Vector here = test::add(at, along, middle);
          (met->within(here[0], here[1]) < 0 ? high : low) = middle;
        }
        at = test::add(at, along, low);
        way += low;
        until -= low;
        if (met->n == 0) {
          if (mirrored || met->reflects == 0) return;
          mirrored = true;
          const test::Vector n = normal(met->within, at);
          along = test::add(along, n, -2 * test::dot(along, n));
          s *= met->reflects;
          p *= met->reflects;
          continue;
        }
        if (!bend(at, along, met->within, 1, n_, met->n, s, p)) {
          // Beyond the critical angle glass is a mirror.
          const test::Vector n = normal(met->within, at);
          along = test::add(along, n, -2 * test::dot(along, n));
          at = test::add(at, along, 1e-7);
          continue;
        }
        if (!to(
                at, along, [&](double x, double y) { return -met->within(x, y); }, true))
          return;
        if (!bend(at, along, met->within, -1, met->n, n_, s, p)) return;
        at = test::add(at, along, 1e-7);
        continue;
      }
      at = there;
      way += next;
      until -= next;
      if (until > 1e-12) continue;
      use(at[0], at[1], (s + p) / 2, way);
      until = step;
    }
  }
  void offset(double share) { offset_ = share; }

 private:
  static constexpr double kMarch = 0.02;
  static test::Vector normal(const Region& of, const test::Vector& at) {
    constexpr double d = 1e-6;
    const double x = of(at[0] + d, at[1]) - of(at[0] - d, at[1]),
                 y = of(at[0], at[1] + d) - of(at[0], at[1] - d);
    const double l = std::hypot(x, y);
    return {x / l, y / l, 0};
  }
  /// To where `stop` falls below 0 (`into`), or where `other` does before `stop` rises above 0.
  static bool to(test::Vector& at, const test::Vector& along, const Region& stop, bool into,
                 const Region* other = nullptr) {
    const auto there = [&](double way) {
      const test::Vector v = test::add(at, along, way);
      return into ? stop(v[0], v[1]) < 0 : (*other)(v[0], v[1]) < 0;
    };
    for (double way = 1e-6; way < 40; way += kMarch) {
      if (!into) {
        const test::Vector v = test::add(at, along, way);
        if (stop(v[0], v[1]) > 0) return false;
      }
      if (!there(way)) continue;
      double low = std::max(0.0, way - kMarch), high = way;
      for (int k = 0; k < 50; ++k) {
        const double middle = (low + high) / 2;
        (there(middle) ? high : low) = middle;
      }
      at = test::add(at, along, high);
      return true;
    }
    return false;
  }
  static bool bend(const test::Vector& at, test::Vector& along, const Region& face, double side,
                   double n, double n_after, double& s, double& p) {
    test::Vector out = normal(face, at);
    for (double& v : out) v *= side;
    const double cosine = -test::dot(along, out);
    if (!(cosine > 0) || 1 - cosine * cosine >= n_after * n_after / (n * n)) return false;
    along = test::refracted(along, out, n, n_after, &s, &p);
    return true;
  }

  const Regions& r_;
  const Vial& vial_;
  double n_;
  double offset_ = 1;
};

/// Doses of a job by rays at random, means over voxels, with their standard errors.
Walked walk_through(const Regions& regions, const TomoJob& job, const Bench& bench, int count) {
  const TomoGrid& g = bench.grid;
  const Printer& p = job.printer;
  const double n = index_of(job.resin), alpha = absorption_per_mm(job.resin);
  const std::size_t voxels = static_cast<std::size_t>(g.slices * g.voxels * g.voxels);
  const Box<float> box{g.slices, g.voxels, g.voxels, {}};
  std::vector<double> sum(voxels), squares(voxels);
  Walked walked;
  std::mt19937 random(7);
  const auto uniform = [&] { return (random() >> 5) * 0x1p-27; };
  Marcher marcher(regions, *p.vial, n);
  const double step = 0.4 * g.voxel_mm();
  // A row of the image for each slice.
  std::vector<int> rows(static_cast<std::size_t>(g.slices), -1);
  for (int r = 0; r < p.height_px; ++r) {
    const int z = bench.places.lit_by(0, p.width_px / 2, r).row;
    if (z >= 0) rows[static_cast<std::size_t>(z)] = r;
  }
  for (int k = 0; k < count; ++k) {
    const int m = static_cast<int>(uniform() * g.angles);
    const double th = 2 * pi * (m + uniform() - 0.5) / g.angles;
    const double column = uniform() * p.width_px - 0.5;
    const auto slice = static_cast<std::size_t>(uniform() * g.slices);
    const FramePlaces::Lit from =
        bench.places.lit_by(m, static_cast<int>(std::round(column)), rows[slice]);
    if (!from.any()) continue;
    const double shown = bench.mw_cm2[job.levels[g.pixel(m, from.pixel, from.row)]];
    if (shown == 0) continue;
    ++walked.rays;
    // x = X cos - Y sin, y = X sin + Y cos.
    const double X = pixel_x_mm(p, column), Y = -30;
    const test::Vector at{X * std::cos(th) - Y * std::sin(th), X * std::sin(th) + Y * std::cos(th),
                          0};
    const test::Vector along{-std::sin(th), std::cos(th), 0};
    marcher.offset(uniform());
    std::vector<std::pair<std::size_t, double>> of_ray;
    marcher.march(at, along, step, [&](double x, double y, double power, double way) {
      const auto ix = std::lround((x + g.radius_mm) / g.voxel_mm()),
                 iy = std::lround((y + g.radius_mm) / g.voxel_mm());
      if (std::min(ix, iy) < 0 || std::max(ix, iy) >= g.voxels) return;
      of_ray.emplace_back(box.at(from.row, static_cast<int>(iy), static_cast<int>(ix)),
                          shown * power * step * std::exp(-alpha * way));
    });
    for (const auto& [v, weight] : of_ray) {
      sum[v] += weight;
      squares[v] += weight * weight;
    }
  }
  const double unit = dose_of_turn(g, bench.exposure) * job.turns * g.angles * p.width_px *
                      g.slices * p.pixel_x_um * p.pixel_y_um * 1e-6 / count /
                      (g.voxel_mm() * g.voxel_mm() * g.slice_height_mm());
  for (std::size_t v = 0; v < voxels; ++v) {
    walked.dose.push_back(unit * sum[v]);
    walked.error.push_back(unit * std::sqrt(squares[v]));
  }
  return walked;
}

/// Operators and judge against the march. `dark`: voxels that must be seen to get nothing.
void expect_march_agrees(const Regions& regions, const Printer& p, int angles = 24) {
  std::mt19937 random(11);
  const TomoJob job = job_of_light(p, bench_resin(2), {0.25, 2, angles},
                                   [&](int, int, int) { return random() % 2 * 255; });
  const Bench bench = make_bench(p, job.resin, job.sampling);
  const TomoGrid& g = bench.grid;
  const Walked want = walk_through(regions, job, bench, 60000);
  const Box<float> judged = dose_of(job);
  const Field solved =
      adjoint(*make_projector(bench), {}, light_of_levels(g, job.levels, bench.mw_cm2));
  const double per_unit = dose_of_turn(g, bench.exposure) * job.turns;
  const double most = *std::max_element(want.dose.begin(), want.dose.end());
  ASSERT_GT(want.rays, 20000);
  int all = 0;
  double off_judged = 0, off_solved = 0, sum = 0;
  for (int z = 0; z < g.slices; ++z) {
    for (int y = 0; y < g.voxels; ++y) {
      for (int x = 0; x < g.voxels; ++x) {
        // Voxels all of which is resin.
        const double far = 0.75 * g.voxel_mm(), px = g.voxel_at_mm(x), py = g.voxel_at_mm(y);
        bool in = std::hypot(px, py) < g.radius_mm && regions.inner(px, py) < -far;
        for (const Body& rod : regions.rods) in = in && rod.within(px, py) > far;
        if (!in) continue;
        ++all;
        const std::size_t v = judged.at(z, y, x);
        const double of_operator = per_unit * solved.values[g.voxel(x, y, z)];
        // Footprints and exact lengths are right to 1 % of large weights and less; light that is bent
        // within a strip is taken as that of its middle, 1 % more. Five standard errors for the rays.
        const double allowed = 5 * want.error[v] + 0.02 * most;
        EXPECT_NEAR(judged.values[v], want.dose[v], allowed) << x << " " << y;
        EXPECT_NEAR(of_operator, want.dose[v], allowed) << x << " " << y;
        off_judged += judged.values[v] - want.dose[v];
        off_solved += of_operator - want.dose[v];
        sum += want.dose[v];
      }
    }
  }
  EXPECT_GT(all, 100);
  const double noise = 4 / std::sqrt(want.rays);
  EXPECT_NEAR(off_judged / sum, 0, 0.005 + noise);
  EXPECT_NEAR(off_solved / sum, 0, 0.01 + noise);
}

Printer square_printer(double corner_mm, double n_outside) {
  Printer p = small_printer(true, 0.25);
  Vial& v = *p.vial;
  v = Vial{1, 1, n_outside, 1.48};
  v.shape = VialShape::square;
  v.side_mm = 4;
  v.wall_mm = 0.3;
  v.corner_mm = corner_mm;
  set_radii(v);
  p.width_px = 26;
  return p;
}

TEST(TomoTraced, RaysAgreeInASquareVial) {
  const Regions regions{rounded(2, 2, 0), rounded(1.7, 1.7, 0), {}};
  expect_march_agrees(regions, square_printer(0, 1));
}
TEST(TomoTraced, RaysAgreeInASquareVialWithRoundCorners) {
  const Regions regions{rounded(2, 2, 0.8), rounded(1.7, 1.7, 0.5), {}};
  expect_march_agrees(regions, square_printer(0.8, 1.33), 12);
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
    const auto projector = make_projector(bench);
    Field field(bench.grid);
    Light light(bench.grid);
    std::mt19937 random(3);
    const TomoGrid& g = bench.grid;
    for (int z = 0; z < slices; ++z) {
      for (int y = 0; y < g.voxels; ++y) {
        for (int x = g.inside(y).first; x < g.inside(y).end; ++x) {
          field.values[g.voxel(x, y, z)] = static_cast<float>(random() % 1000) * 1e-3F;
        }
      }
      for (int m = 0; m < g.angles; ++m) {
        for (int i = 0; i < g.pixels; ++i) {
          light.values[g.pixel(m, i, z)] = static_cast<float>(random() % 1000) * 1e-3F;
        }
      }
    }
    ExecutionContext alone;
    alone.threads = 1;
    const Light ax = forward(*projector, {}, field);
    const Field atb = adjoint(*projector, {}, light);
    EXPECT_EQ(ax.values, forward(*make_projector(bench), alone, field).values);
    EXPECT_EQ(atb.values, adjoint(*make_projector(bench), alone, light).values);
    double left = 0, right = 0;
    for (std::size_t i = 0; i < ax.values.size(); ++i)
      left += double{ax.values[i]} * light.values[i];
    for (std::size_t i = 0; i < atb.values.size(); ++i)
      right += double{atb.values[i]} * field.values[i];
    ASSERT_GT(left, 0);
    EXPECT_NEAR(right / left, 1, 1e-5) << slices;
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
  Printer point = p;
  point.optics->kind = OpticsKind::pinhole;
  point.optics->distance_mm = 60;
  EXPECT_TRUE(has(words(point, bench_resin()), "expected telecentric light"));
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
