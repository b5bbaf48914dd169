// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Printers whose slices share light: from bench to frames, to doses that are found backwards from the voxel, to a
// solve; inserts; what is refused.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>

#include "rounds.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/tomo/print.hpp"
#include "slicecorr/vial.hpp"
#include "snell.hpp"
#include "stack_fixture.hpp"
#include "tomo/operators/ray_sources.hpp"
#include "tomo_jobs.hpp"

namespace slicecorr::tomo {
namespace {

using std::numbers::pi;
using ::testing::HasSubstr;

/// A dry vial of 4 mm before a pinhole, 40 mm away.
Printer pinhole_printer() {
  Printer p = dry_printer();
  p.width_px = 192;
  p.height_px = 160;
  p.pixel_x_um = p.pixel_y_um = 62.5;
  p.optics->kind = OpticsKind::pinhole;
  p.optics->distance_mm = 40;
  p.optics->axis_right_px = 0;
  p.optics->axis_up_px = 0;
  return p;
}
Printer aperture_printer() {
  Printer p = pinhole_printer();
  p.optics->half_angle_deg = 3;
  p.optics->rays_per_pixel = 7;
  return p;
}

/// All pixels at the brightest level, through one turn.
TomoJob white_job(const Printer& printer, double voxel_mm, int slices, int angles,
                  double alpha_per_cm) {
  TomoJob job;
  job.printer = printer;
  job.resin = bench_resin(alpha_per_cm);
  job.sampling = {voxel_mm, slices, angles};
  const Bench bench = make_bench(job.printer, job.resin, job.sampling);
  const TomoGrid& g = bench.grid;
  job.part = {g.slices, g.voxels, g.voxels, {}};
  job.part.values.assign(static_cast<std::size_t>(g.slices * g.voxels * g.voxels), 0);
  job.levels.assign(g.light_of_block(), 0);
  for (int m = 0; m < g.angles; ++m) {
    for (int i = 0; i < g.pixels; ++i) {
      for (int r = 0; r < g.rows; ++r) job.levels[g.pixel(m, i, r)] = 255;
    }
  }
  return job;
}

/// Webber's machine, with coarse pixels.
Printer webber(OpticsKind kind) {
  Printer p = pinhole_printer();
  p.width_px = 130;
  p.height_px = 60;
  p.pixel_x_um = p.pixel_y_um = 216;
  p.vial = Vial{12.5, 11.8, 1.0, 1.48};
  p.optics = slicecorr::Optics{};
  p.optics->kind = kind;
  p.optics->distance_mm = kind == OpticsKind::pinhole ? 99.5 : 0;
  p.rotation = Rotation{25, TurnDirection::clockwise, 0};
  return p;
}
Resin webber_resin(double alpha_per_mm) {
  Resin r = bench_resin(10 * alpha_per_mm);
  r.n = 1.49969;
  return r;
}

TEST(TomoCoupled, SourcesAreFoundBackwards) {
  for (Printer p : {pinhole_printer(), aperture_printer(), webber(OpticsKind::pinhole)}) {
    p.optics->tilt_deg = 2;
    const double n = 1.5, alpha = 0.1;
    const detail::RaySources sources(p, n, alpha, -3, 3, {});
    const auto points =
        aperture_points(p.optics->half_angle_deg > 0 ? p.optics->rays_per_pixel : 1);
    const double reach = std::tan(p.optics->half_angle_deg * pi / 180);
    std::mt19937 random(3);
    const auto uniform = [&] { return (random() >> 5) * 0x1p-27; };
    int seen = 0;
    for (int i = 0; i < 300; ++i) {
      const double column = uniform() * (p.width_px - 1), row = uniform() * (p.height_px - 1);
      const int k = static_cast<int>(uniform() * sources.rays());
      LightLine line = chief_ray(p, column, row);
      line.slope_x += points[static_cast<std::size_t>(k)].x * reach;
      line.slope_z += points[static_cast<std::size_t>(k)].z * reach;
      const auto ray = ray_in_resin(*p.vial, n, line);
      if (!ray || std::abs(ray->t_mm) > 0.99 * p.vial->outer_mm / n) continue;
      const double flat = std::sqrt(1 - ray->kz * ray->kz), half = 0.5 * ray->chord_mm * flat;
      const double u = (2 * uniform() - 1) * half;
      const double z = ray->entry_z_mm + ray->kz / flat * (u + half);
      if (std::abs(z) > 3) continue;
      ++seen;
      const detail::RaySource from = sources.solve(k, ray->t_mm, u, z);
      EXPECT_NEAR(from.column, column, 1e-5);
      EXPECT_NEAR(from.row, row, 1e-5);
      EXPECT_NEAR(from.turn_rad, ray->turn_rad, 1e-8);
      // Tables: errors of a hundredth of a pixel and a thousandth of the light, as docs say.
      std::vector<detail::RaySource> places(1);
      sources.along_z(k, ray->t_mm, u, z, 0.1, places);
      EXPECT_NEAR(places[0].column, column, 0.02) << ray->t_mm;
      EXPECT_NEAR(places[0].row, row, 0.02) << ray->t_mm;
      EXPECT_NEAR(places[0].share / from.share, 1, 0.002) << ray->t_mm << " " << u;
    }
    EXPECT_GT(seen, 50);
  }
}

/// Light of all pixels: closed forms, V of the checked values; what judges has no grid of rays.
TEST(TomoCoupled, UniformLightAddsUpAsPrinted) {
  struct Row {
    OpticsKind kind;
    double half_angle_deg, alpha_per_mm;
    std::vector<std::pair<double, double>> at_mm;  ///< what is to be there
  };
  // A cone of 0.01 degrees makes telecentric light light of rays, and no more.
  for (const Row& row :
       {Row{OpticsKind::telecentric, 0.01, 0, {{0, 1.44345}, {4, 1.44281}, {8, 1.38306}}},
        {OpticsKind::telecentric, 0.01, 1 / 11.8, {{4, .56231}, {8, .64389}}},
        {OpticsKind::pinhole, 0, 0, {{0, 1.50641}}},
        {OpticsKind::pinhole, 0, .05, {{4, .82417 / .958204}, {7, .87013 / .958204}}}}) {
    Printer p = webber(row.kind);
    p.optics->half_angle_deg = row.half_angle_deg;
    p.optics->rays_per_pixel = 2;
    TomoJob job = white_job(p, 0.25, 3, 36, 1);
    job.resin = webber_resin(row.alpha_per_mm == 0 ? 1e-9 : row.alpha_per_mm);
    const Bench bench = make_bench(job.printer, job.resin, job.sampling);
    const Box<float> dose = dose_of(job);
    const double unit = bench.exposure.alpha_a_per_cm * bench.mw_cm2.back() * bench.exposure.turn_s;
    for (const auto& [r_mm, want] : row.at_mm) {
      const auto x = static_cast<int>(std::lround(r_mm / 0.25)) + (bench.grid.voxels - 1) / 2;
      const double got = dose.values[dose.at(1, (bench.grid.voxels - 1) / 2, x)] / unit;
      // Figures of a pinhole off the axis are those of the plane alone: rows come together, too, by mu
      // on the axis, and elsewhere by about as much.
      const bool in_plane = row.kind == OpticsKind::pinhole && r_mm > 0;
      EXPECT_NEAR(got / want, 1, in_plane ? 0.01 : 0.002) << r_mm << " " << row.alpha_per_mm;
    }
  }
}

/// How far the sum of linear weights of a voxel is from even, over lines so many voxels apart that are
/// met at up to `steepest` from the axis which they cross: by the place among the lines.
struct Beat {
  double deviation = 0;  ///< of all places and angles
  double most = 0;       ///< at the worst place, in the mean over angles
};
Beat beat(double apart, double steepest) {
  constexpr int kPlaces = 200, kAngles = 50;
  Beat b;
  for (int i = 0; i < kPlaces; ++i) {
    double mean = 0;
    for (int a = 0; a < kAngles; ++a) {
      const double d = apart / std::cos(steepest * (a + 0.5) / kAngles),
                   at = d * (i + 0.5) / kPlaces;
      double sum = 0;
      for (int k = -4; k <= 4; ++k) sum += d * std::max(0.0, 1 - std::abs(at + k * d));
      mean += (sum - 1) / kAngles;
      b.deviation += (sum - 1) * (sum - 1) / kAngles / kPlaces;
    }
    b.most = std::max(b.most, std::abs(mean));
  }
  b.deviation = std::sqrt(b.deviation);
  return b;
}

/// What the solver's operators say of smooth light is what the backward sum says.
TEST(TomoCoupled, OperatorsAgreeWithTheDirectSum) {
  for (const Printer& printer : {pinhole_printer(), aperture_printer()}) {
    TomoJob job = white_job(printer, 0.25, 12, 48, 2.5);
    const Bench bench = make_bench(job.printer, job.resin, job.sampling);
    const TomoGrid& g = bench.grid;
    for (int m = 0; m < g.angles; ++m) {
      for (int i = 0; i < g.pixels; ++i) {
        for (int r = 0; r < g.rows; ++r) {
          job.levels[g.pixel(m, i, r)] = static_cast<std::uint16_t>(std::lround(
              120 + 60 * std::sin(0.3 * i + 2 * pi * m / g.angles) + 50 * std::cos(0.25 * r)));
        }
      }
    }
    const Box<float> direct = dose_of(job);
    const Field field =
        adjoint(*make_projector(bench), {}, light_of_levels(g, job.levels, bench.mw_cm2));
    const double unit = dose_of_turn(g, bench.exposure);
    double worst = 0, sum = 0;
    int count = 0;
    for (int z = 2; z < g.slices - 2; ++z) {
      for (int y = 0; y < g.voxels; ++y) {
        for (int x = 0; x < g.voxels; ++x) {
          if (std::hypot(g.voxel_at_mm(x), g.voxel_at_mm(y)) > 2.2) continue;
          const double a = unit * field.values[g.voxel(x, y, z)];
          const double off = std::abs(a / direct.values[direct.at(z, y, x)] - 1);
          worst = std::max(worst, off);
          sum += off;
          ++count;
        }
      }
    }
    // Lines beat with voxels, at random from angle to angle but near the axis, where all angles see the
    // same; and linear light that bends is met by lines, not in between: (k d)^2 / 12 of each wave.
    const double along = g.pixel_mm / g.voxel_mm(),
                 up = (z_of_row(bench, 1) - z_of_row(bench, 0)) / g.slice_height_mm();
    const Beat across = beat(along, pi / 4), rows = beat(up, 0);
    const double bent = (0.3 * 0.3 * 60 + 0.25 * 0.25 * 50) / 12 / 120;
    const double each = std::hypot(across.deviation, rows.deviation);
    EXPECT_LT(sum / count, each * std::sqrt(2 / pi / g.angles) + bent);
    EXPECT_LT(worst, across.most + rows.most + bent);
  }
}

TEST(TomoCoupled, InsertsEndRays) {
  Printer p = pinhole_printer();
  const Sampling sampling{0.25, 8, 64};
  const Bench bench = make_bench(p, bench_resin(1e-6), sampling);
  const TomoGrid& g = bench.grid;
  Volume rod(g);
  const double a = 0.8;
  for (int z = 0; z < g.slices; ++z) {
    for (int y = 0; y < g.voxels; ++y) {
      for (int x = 0; x < g.voxels; ++x) {
        if (std::hypot(g.voxel_at_mm(x), g.voxel_at_mm(y)) < a)
          rod.coverage[g.voxel(x, y, z)] = 255;
      }
    }
  }
  const auto open = make_projector(bench), shaded = make_projector(bench, &rod);
  std::mt19937 random(4);
  Light light(g);
  Field field(g);
  for (int m = 0; m < g.angles; ++m) {
    for (int i = 0; i < g.pixels; ++i) {
      for (int r = 0; r < g.rows; ++r)
        light.values[g.pixel(m, i, r)] = static_cast<float>(random() % 100);
    }
  }
  for (int z = 0; z < g.slices; ++z) {
    for (int y = 0; y < g.voxels; ++y) {
      for (int x = g.inside(y).first; x < g.inside(y).end; ++x) {
        field.values[g.voxel(x, y, z)] = static_cast<float>(random() % 100);
      }
    }
  }
  const auto dot = [](const Array<float>& u, const Array<float>& v) {
    double sum = 0;
    for (std::size_t i = 0; i < u.size(); ++i) sum += static_cast<double>(u[i]) * v[i];
    return sum;
  };
  // Both see the same shadow: transposes to the rounding of single precision.
  EXPECT_NEAR(dot(forward(*shaded, {}, field).values, light.values) /
                  dot(field.values, adjoint(*shaded, {}, light).values),
              1, 1e-6);
  // At distance r from a rod of radius a, 1 - asin(a/r)/pi of the directions are seen.
  Light white(g);
  for (int m = 0; m < g.angles; ++m) {
    for (int i = 0; i < g.pixels; ++i) {
      for (int r = 0; r < g.rows; ++r) white.values[g.pixel(m, i, r)] = 1;
    }
  }
  const Field all = adjoint(*open, {}, white), seen = adjoint(*shaded, {}, white);
  TomoJob job = white_job(p, 0.25, 8, 64, 1e-6);
  const Box<float> direct_all = dose_of(job);
  job.insert = {g.slices, g.voxels, g.voxels, {}};
  for (int z = 0; z < g.slices; ++z) {
    for (int y = 0; y < g.voxels; ++y) {
      for (int x = 0; x < g.voxels; ++x)
        job.insert.values.push_back(rod.coverage[g.voxel(x, y, z)]);
    }
  }
  const Box<float> direct_seen = dose_of(job);
  for (const double r : {1.5, 2.0}) {
    double sum_all = 0, sum_seen = 0, sum_direct_all = 0, sum_direct = 0;
    for (int y = 0; y < g.voxels; ++y) {
      for (int x = 0; x < g.voxels; ++x) {
        if (std::abs(std::hypot(g.voxel_at_mm(x), g.voxel_at_mm(y)) - r) > 0.15) continue;
        sum_all += all.values[g.voxel(x, y, 4)];
        sum_seen += seen.values[g.voxel(x, y, 4)];
        sum_direct_all += direct_all.values[direct_all.at(4, y, x)];
        sum_direct += direct_seen.values[direct_seen.at(4, y, x)];
      }
    }
    const double want = 1 - std::asin(a / r) / pi;
    // The rod is made of squares of 0.25 mm, so its radius is known to half of one.
    const double known = 0.125 / (pi * std::sqrt(r * r - a * a));
    EXPECT_NEAR(sum_seen / sum_all, want, known) << r;
    EXPECT_NEAR(sum_direct / sum_direct_all, want, known) << r;
  }
}

/// A ring of 4 voxels, with a plate across it in the middle of its height.
Box<std::uint8_t> wheel() {
  const int n = 19, slices = 12;
  Box<std::uint8_t> part{slices, n, n, {}};
  for (int z = 0; z < slices; ++z) {
    for (int y = 0; y < n; ++y) {
      for (int x = 0; x < n; ++x) {
        const double r = std::hypot(x - 0.5 * (n - 1), y - 0.5 * (n - 1));
        const bool rim = r > 4.2 && r < 8.4,
                   plate = r <= 4.2 && z >= slices / 3 && z < 2 * slices / 3;
        part.values.push_back(rim || plate ? 255 : 0);
      }
    }
  }
  return placed(part, pinhole_printer(), 0.25);
}

TEST(TomoCoupled, APartIsSolvedAndPrinted) {
  const Box<std::uint8_t> part = wheel();
  struct Case {
    Printer printer;
    Method method;
    int angles;
  };
  std::vector<Case> cases{{pinhole_printer(), Method::ladder, test::by_night() ? 48 : 24},
                          {aperture_printer(), Method::osmo, 24}};
  // By day FramesFollowAnAxisThatWobbles has it.
  if (test::by_night()) cases.push_back({pinhole_printer(), Method::osmo, 48});
  for (const Case& c : cases) {
    PrintOptions options;
    options.angles = c.angles;
    options.solve.method = c.method;
    options.solve.rungs = {.98, .8, .5};
    options.solve.steps = 30;
    options.solve.most_steps = test::by_night() ? 100 : 30;
    options.solve.proof_steps = 20;
    ExecutionContext one, three;
    one.threads = 1;
    three.threads = 3;
    const Print print = solve_print(part, 0.25, c.printer, bench_resin(), options, one);
    EXPECT_EQ(print.figures.metrics.ver, 0) << static_cast<int>(c.method);
    EXPECT_TRUE(print.figures.feasible());
    if (c.method == Method::ladder) {
      EXPECT_LT(print.figures.contrast_bound, 3.5);
      EXPECT_GE(print.figures.contrast_bound, print.figures.metrics.contrast);
      // Threads change nothing, which few angles and steps show as well.
      options.angles = 12;
      options.solve.steps = options.solve.most_steps = 5;
      const auto levels = [&](const ExecutionContext& context) {
        return solve_print(part, 0.25, c.printer, bench_resin(), options, context).job.levels;
      };
      EXPECT_EQ(levels(one), levels(three));
    }
  }
}

TEST(TomoCoupled, ResumesFromACheckpoint) {
  const Bench bench = make_bench(pinhole_printer(), bench_resin(), {0.25, 12, 18});
  Volume volume(bench.grid);
  const Box<std::uint8_t> part = wheel();
  for (int z = 0; z < part.nz; ++z) {
    for (int y = 0; y < part.ny; ++y) {
      for (int x = 0; x < part.nx; ++x) {
        volume.coverage[bench.grid.voxel(x, y, z)] = part.values[part.at(z, y, x)];
      }
    }
  }
  const Target target(volume);
  const auto projector = make_search_projector(bench, Search::close);
  SolveOptions options;
  options.rungs = {.98, .9, .6};
  options.steps = options.most_steps = 15;
  std::vector<SolverState> places;
  options.checkpoint = [&](const SolverPlace& at) {
    places.push_back({at.numbers, at.dose, at.of_slices, at.missed, at.rung, at.step, at.best});
  };
  const Solution whole = solve({}, *projector, target, bench.rays, options);
  ASSERT_GE(places.size(), 2U);
  options.checkpoint = nullptr;
  // The first, the last and some between them.
  const std::size_t parts = test::by_night() ? 3 : 2;
  for (std::size_t i = 0; i < places.size();
       i += std::max<std::size_t>(1, (places.size() - 1) / parts)) {
    options.resume = &places[i];
    EXPECT_EQ(solve({}, *projector, target, bench.rays, options).light, whole.light);
  }
}

TEST(TomoCoupled, AJobIsWrittenAndReadAgain) {
  Printer p = pinhole_printer();
  // Over a leaning and wobbling axis.
  p.pixel_x_um = p.pixel_y_um = 100;
  p.width_px = 120;
  p.height_px = 70;
  p.optics->tilt_deg = 1;
  p.rotation->wobble = {{0, 3, 0}, {120, -2, 4}, {240, 0, -3}};
  TomoJob job = white_job(p, 0.25, 10, 24, 2.5);
  const Bench bench = make_bench(job.printer, job.resin, job.sampling);
  const TomoGrid& g = bench.grid;
  EXPECT_EQ(bench.window.wide, 1);
  // Light is looked for in squares of at most a voxel: dry, 0.067 mm lie side by side in 0.25.
  const Bench groups = make_bench(p, job.resin, {0.25, 10, 24, true});
  EXPECT_EQ(groups.window.wide, 3);
  EXPECT_EQ(groups.window.high, 2);
  std::mt19937 random(8);
  // Light near the image's edges may be moved out of it: what stays in is read again.
  std::vector<bool> shown(job.levels.size(), false);
  for (int m = 0; m < g.angles; ++m) {
    for (int row = 0; row < p.height_px; ++row) {
      for (int column = 0; column < p.width_px; ++column) {
        const FramePlaces::Lit lit = bench.places.lit_by(m, column, row);
        if (lit.any()) shown[g.pixel(m, lit.pixel, lit.row)] = true;
      }
    }
  }
  EXPECT_GT(std::count(shown.begin(), shown.end(), true), 0.8 * g.angles * g.pixels * g.rows);
  for (std::size_t i = 0; i < shown.size(); ++i) {
    job.levels[i] = shown[i] ? static_cast<std::uint16_t>(random() % 256) : 0;
  }
  const test::TemporaryFolder folder;
  write_job(folder / "a.frames", job);
  EXPECT_EQ(read_job(folder / "a.frames").levels, job.levels);
}

/// The axis goes astray and the frames follow: the same dose as of a steady one, to half a pixel.
TEST(TomoCoupled, FramesFollowAnAxisThatWobbles) {
  Printer steady = pinhole_printer();
  steady.pixel_x_um = steady.pixel_y_um = 50;
  steady.width_px = 240;
  steady.height_px = 130;
  Printer moved = steady;
  moved.rotation->wobble = {{0, 4, 0}, {180, -4, 6}};
  PrintOptions options;
  options.angles = 48;
  options.solve.method = Method::osmo;
  const Box<std::uint8_t> part = wheel();
  const Print print = solve_print(part, 0.25, moved, bench_resin(), options);
  EXPECT_EQ(print.figures.metrics.ver, 0);
  // The same images before an axis that stands still are 0.2 mm and more beside.
  TomoJob still = print.job;
  still.printer = steady;
  const Bench from = make_bench(moved, bench_resin(), still.sampling),
              to = make_bench(steady, bench_resin(), still.sampling);
  still.levels.assign(to.grid.light_of_block(), 0);
  for (int frame = 0; frame < to.grid.angles; ++frame) {
    const GreyImage image = frame_image(print.job, from, frame);
    const int m = to.frame_of_angle(frame);
    for (int row = 0; row < image.height_px; ++row) {
      for (int column = 0; column < image.width_px; ++column) {
        const FramePlaces::Lit lit = to.places.lit_by(m, column, row);
        if (!lit.any()) continue;
        still.levels[to.grid.pixel(m, lit.pixel, lit.row)] =
            image.pixels[static_cast<std::size_t>(row) * static_cast<std::size_t>(image.width_px) +
                         static_cast<std::size_t>(column)];
      }
    }
  }
  EXPECT_GT(figures_of(still, dose_of(still), still.part).metrics.ver, 0.005);
}

TEST(TomoCoupled, RefusesWhatDoesNotFit) {
  const auto said = [](const Printer& p, const Sampling& sampling) -> std::string {
    try {
      make_bench(p, bench_resin(), sampling);
    } catch (const InputError& e) {
      return e.what();
    }
    return "nothing";
  };
  Printer p = pinhole_printer();
  EXPECT_THAT(said(p, {0.25, 60, 36}), HasSubstr("its image lights"));
  EXPECT_THAT(said(p, {0.25, 1, 36}), HasSubstr("slices"));
  EXPECT_THAT(said(p, {0.05, 9, 36}), HasSubstr("its rows are 0.0625 mm high"));
  p.optics->axis_right_px = 1e4;
  EXPECT_THAT(said(p, {0.25, 12, 36}), HasSubstr("none of its pixels meets the resin"));
  p = pinhole_printer();
  p.optics->axis_up_px = 1e4;
  EXPECT_THAT(said(p, {0.25, 12, 36}), HasSubstr("lights"));
}

}  // namespace
}  // namespace slicecorr::tomo
