// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file tomo_regions.hpp
/// Vials that are not round, and rods in the resin, as regions that a distance function alone knows: rays that are
/// marched at random through them, with normals from its differences and Snell's law in vectors.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <numbers>
#include <random>
#include <vector>

#include "slicecorr/tomo/print.hpp"
#include "slicecorr/vial.hpp"
#include "slicecorr/vial_outline.hpp"
#include "snell.hpp"
#include "tomo_jobs.hpp"
#include "tomo_walk.hpp"

namespace slicecorr::tomo::traced_test {

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

inline Region rounded(double half_x, double half_y, double radius) {
  return [=](double x, double y) {
    const double a = std::abs(x) - (half_x - radius), b = std::abs(y) - (half_y - radius);
    return std::hypot(std::max(a, 0.0), std::max(b, 0.0)) + std::min(std::max(a, b), 0.0) - radius;
  };
}
inline Region hexagon(double apothem) {
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
inline Region disc(double x0, double y0, double radius) {
  return [=](double x, double y) { return std::hypot(x - x0, y - y0) - radius; };
}

/// What a ray leaves, marched by small steps in the frame of the part: calls use(at, power, way) at places every
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
      use(at, (s + p) / 2, way);
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

/// A place of the image and a ray of its pixel, in the machine's frame: level, from a point, or through an aperture
/// whose rays meet in focus on the plane of the axis.
struct FromImage {
  test::Vector at, along;
};
inline FromImage from_image(const Printer& p, double column, double row, double pick) {
  const double X = pixel_x_mm(p, column), Z = pixel_z_mm(p, row);
  const Optics& o = *p.optics;
  test::Vector along{0, 1, 0};
  if (o.kind == OpticsKind::pinhole) along = {X / o.distance_mm, 1, Z / o.distance_mm};
  if (o.half_angle_deg > 0) {
    const auto points = aperture_points(o.rays_per_pixel);
    const AperturePoint& point =
        points[static_cast<std::size_t>(pick * static_cast<double>(points.size()))];
    along[0] += point.x * std::tan(o.half_angle_deg * pi / 180);
    along[2] += point.z * std::tan(o.half_angle_deg * pi / 180);
  }
  const double length = std::sqrt(test::dot(along, along));
  for (double& v : along) v /= length;
  return {test::add({X, 0, Z}, along, -30), along};
}
inline test::Vector turned(const test::Vector& v, double th) {
  // x = X cos - Y sin, y = X sin + Y cos.
  return {v[0] * std::cos(th) - v[1] * std::sin(th), v[0] * std::sin(th) + v[1] * std::cos(th),
          v[2]};
}

/// Doses of a job by rays at random, means over voxels, with their standard errors.
inline Walked walk_through(const Regions& regions, const TomoJob& job, const Bench& bench,
                           int count) {
  const TomoGrid& g = bench.grid;
  const Printer& p = job.printer;
  const double n = index_of(job.resin), alpha = absorption_per_mm(job.resin);
  const std::size_t voxels = static_cast<std::size_t>(g.slices * g.voxels * g.voxels);
  const Box<float> box{g.slices, g.voxels, g.voxels, {}};
  std::vector<double> sum(voxels), squares(voxels);
  Walked walked;
  std::mt19937 random(7);
  const auto uniform = [&] { return (random() >> 5) * 0x1p-27; };
  const int lit_rows = g.coupled() ? p.height_px : g.slices;
  Marcher marcher(regions, *p.vial, n);
  const double step = 0.4 * g.voxel_mm();
  // A row of the image for each slice.
  std::vector<int> rows(static_cast<std::size_t>(g.light_rows()), -1);
  for (int r = 0; r < p.height_px; ++r) {
    const int z = bench.places.lit_by(0, p.width_px / 2, r).row;
    if (z >= 0) rows[static_cast<std::size_t>(z)] = r;
  }
  for (int k = 0; k < count; ++k) {
    const int m = static_cast<int>(uniform() * g.angles);
    const double th = 2 * pi * (m + uniform() - 0.5) / g.angles;
    const double column = uniform() * p.width_px - 0.5;
    // Level light lights the slice that its row is of.
    const double row = uniform() * lit_rows - 0.5;
    const int of_row = static_cast<int>(std::round(row));
    const FramePlaces::Lit from =
        bench.places.lit_by(m, static_cast<int>(std::round(column)),
                            g.coupled() ? of_row : rows[static_cast<std::size_t>(of_row)]);
    if (!from.any()) continue;
    const double shown = bench.mw_cm2[job.levels[g.pixel(m, from.pixel, from.row)]];
    if (shown == 0) continue;
    ++walked.rays;
    const FromImage ray = from_image(p, column, row, uniform());
    marcher.offset(uniform());
    std::vector<std::pair<std::size_t, double>> of_ray;
    marcher.march(
        turned(ray.at, th), turned(ray.along, th), step,
        [&](const test::Vector& at, double power, double way) {
          const auto ix = std::lround((at[0] + g.radius_mm) / g.voxel_mm()),
                     iy = std::lround((at[1] + g.radius_mm) / g.voxel_mm());
          const auto iz =
              g.coupled() ? std::lround((at[2] - g.lowest_mm) / g.slice_height_mm()) : from.row;
          if (std::min({ix, iy, iz}) < 0 || std::max(ix, iy) >= g.voxels || iz >= g.slices) return;
          const std::size_t v =
              box.at(static_cast<int>(iz), static_cast<int>(iy), static_cast<int>(ix));
          const double weight = shown * power * step * std::exp(-alpha * way);
          // Places of a ray in one voxel are not independent: their errors add up.
          if (!of_ray.empty() && of_ray.back().first == v) {
            of_ray.back().second += weight;
          } else {
            of_ray.emplace_back(v, weight);
          }
        });
    for (const auto& [v, weight] : of_ray) {
      sum[v] += weight;
      squares[v] += weight * weight;
    }
  }
  const double unit = dose_of_turn(g, bench.exposure) * job.turns * g.angles * p.width_px *
                      lit_rows * p.pixel_x_um * p.pixel_y_um * 1e-6 / count /
                      (g.voxel_mm() * g.voxel_mm() * g.slice_height_mm());
  for (std::size_t v = 0; v < voxels; ++v) {
    walked.dose.push_back(unit * sum[v]);
    walked.error.push_back(unit * std::sqrt(squares[v]));
  }
  return walked;
}

/// Operators and judge against the march.
struct MarchOptions {
  Sampling sampling{0.25, 2, 24};
  int rays = 60000, least_lit = 20000;
};
inline void expect_march_agrees(const Regions& regions, const Printer& p,
                                const MarchOptions& options = {}) {
  std::mt19937 random(11);
  const TomoJob job = job_of_light(p, bench_resin(2), options.sampling,
                                   [&](int, int, int) { return random() % 2 * 255; });
  const Bench bench = make_bench(p, job.resin, job.sampling);
  const TomoGrid& g = bench.grid;
  const Walked want = walk_through(regions, job, bench, options.rays);
  const Box<float> judged = dose_of(job);
  const Field solved =
      adjoint(*make_projector(bench), {}, light_of_levels(g, job.levels, bench.mw_cm2));
  const double per_unit = dose_of_turn(g, bench.exposure) * job.turns;
  const double most = *std::max_element(want.dose.begin(), want.dose.end());
  ASSERT_GT(want.rays, options.least_lit);
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

inline Printer square_printer(double corner_mm, double n_outside) {
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

}  // namespace slicecorr::tomo::traced_test
