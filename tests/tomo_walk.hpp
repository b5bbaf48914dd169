// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file tomo_walk.hpp
/// Doses of jobs by rays marched at random, by Snell's law in vectors: places on the display, gaps between
/// pixels, blur of the projector, a bath's window, both walls of the vial, and scatter on the way.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>
#include <vector>

#include "slicecorr/tomo/print.hpp"
#include "slicecorr/vial.hpp"
#include "snell.hpp"
#include "tomo_jobs.hpp"

namespace slicecorr::tomo {

using std::numbers::pi;

/// The ray of a pinhole from its point in air through both faces of a bath's window, as it would go on to
/// the plane of the axis. `power`: what the window lets through.
inline LightLine through_window(const Printer& p, double column, double row, double* power) {
  const Bath& b = *p.bath;
  const PlanePlace place = pixel_mm(p, column, row);
  const bool point = p.optics->kind == OpticsKind::pinhole;
  const double from = point ? -p.optics->distance_mm : -2 * b.window_mm;
  test::Vector at{point ? 0 : place.x_mm, from, point ? 0 : place.z_mm};
  test::Vector along = test::add({place.x_mm, 0, place.z_mm}, at, -1);
  const double length = std::sqrt(test::dot(along, along));
  for (double& v : along) v /= length;
  double s = 1, q = 1;
  const auto face = [&](double y, double n, double n_after) {
    at = test::add(at, along, (y - at[1]) / along[1]);
    along = test::refracted(along, {0, -1, 0}, n, n_after, &s, &q);
  };
  face(-b.window_mm, 1, b.n_wall);
  face(-b.window_mm + b.wall_mm, b.n_wall, b.n);
  at = test::add(at, along, -at[1] / along[1]);
  *power = (s + q) / 2;
  return {at[0], at[2], along[0] / along[1], along[2] / along[1]};
}

/// Doses of a job by rays: a time, a place on the image, both walls by Snell's law, places on the way. Means over voxels,
/// with their standard errors.
struct Walked {
  std::vector<double> dose, error;
  int rays = 0;  ///< that bring light
};
inline Walked walk(const TomoJob& job, const Bench& bench, int count) {
  const TomoGrid& g = bench.grid;
  const Printer& p = job.printer;
  const double n = index_of(job.resin), alpha = absorption_per_mm(job.resin);
  const double height = g.slice_height_mm(),
               low = g.coupled() ? g.lowest_mm : bench.places.lowest_mm();
  Box<float> box{g.slices, g.voxels, g.voxels, {}};
  const std::size_t voxels =
      static_cast<std::size_t>(g.slices) * static_cast<std::size_t>(g.voxels * g.voxels);
  std::vector<double> sum(voxels), squares(voxels);
  Walked walked;
  std::mt19937 random(7);
  const auto uniform = [&] { return (random() >> 5) * 0x1p-27; };
  const auto normal = [&] {
    const double away = std::sqrt(-2 * std::log(1 - uniform()));
    return away * std::cos(2 * pi * uniform());
  };
  const double lit = std::sqrt(p.fill_factor);
  for (int k = 0; k < count; ++k) {
    const int m = static_cast<int>(uniform() * g.angles);
    const double th = 2 * pi * (m + uniform() - 0.5) / g.angles;
    const double column = uniform() * p.width_px - 0.5, row = uniform() * p.height_px - 0.5;
    // Where the light of this place left the display.
    double from_column = column, from_row = row, picked = uniform();
    for (const SpreadGaussian& spot : p.spread.gaussians) {
      picked -= spot.weight;
      if (picked > 0) continue;
      from_column += spot.sigma_um / p.pixel_x_um * normal();
      from_row += spot.sigma_um / p.pixel_y_um * normal();
      break;
    }
    if (const auto& picture = p.spread.picture) {
      // One of its pixels by how bright it is, and a place in it.
      double all = 0;
      for (const std::uint8_t v : *picture->values) all += v;
      picked = uniform() * all;
      int k = 0;
      while ((picked -= (*picture->values)[static_cast<std::size_t>(k)]) > 0) ++k;
      const int columns = k % picture->width_px - picture->width_px / 2,
                rows = k / picture->width_px - picture->height_px / 2;
      const double right = columns + uniform() - 0.5, down = rows + uniform() - 0.5;
      from_column -= right * picture->pitch_um / p.pixel_x_um;
      from_row -= down * picture->pitch_um / p.pixel_y_um;
    }
    const double pixel = std::round(from_column), of_row = std::round(from_row);
    if (pixel < 0 || pixel >= p.width_px || of_row < 0 || of_row >= p.height_px) continue;
    if (std::max(std::abs(from_column - pixel), std::abs(from_row - of_row)) > lit / 2) continue;
    const FramePlaces::Lit from =
        bench.places.lit_by(m, static_cast<int>(pixel), static_cast<int>(of_row));
    if (!from.any()) continue;
    const double shown = bench.mw_cm2[job.levels[g.pixel(m, from.pixel, from.row)]] / p.fill_factor;
    if (shown == 0) continue;
    double window = 1;
    const LightLine line =
        p.bath ? through_window(p, column, row, &window) : chief_ray(p, column, row);
    if (misses(*p.vial, n, line.q_mm(), line.kz())) continue;
    test::Marched ray = test::march(*p.vial, n, line);
    ray.power *= window;
    const test::Vector way = test::add(ray.exit, ray.entry, -1);
    const double chord = std::sqrt(test::dot(way, way));
    ++walked.rays;
    constexpr int kPlaces = 12;
    for (int i = 0; i < kPlaces; ++i) {
      const double along = (i + uniform()) / kPlaces;
      test::Vector at = test::add(ray.entry, way, along);
      if (job.resin.scatter_um2_per_um > 0) {
        // To both sides across the ray.
        const double sigma = std::sqrt(job.resin.scatter_um2_per_um * 1e-3 * along * chord);
        const test::Vector& d = ray.direction;
        const double flat = std::hypot(d[0], d[1]);
        const test::Vector side{d[1] / flat, -d[0] / flat, 0};
        const test::Vector up{-d[0] * d[2] / flat, -d[1] * d[2] / flat, flat};
        at = test::add(test::add(at, side, sigma * normal()), up, sigma * normal());
        if (std::hypot(at[0], at[1]) > p.vial->inner_mm) continue;
      }
      const double x = at[0] * std::cos(th) - at[1] * std::sin(th),
                   y = at[0] * std::sin(th) + at[1] * std::cos(th);
      const auto ix = std::lround((x + g.radius_mm) / g.voxel_mm()),
                 iy = std::lround((y + g.radius_mm) / g.voxel_mm()),
                 iz = std::lround((at[2] - low) / height);
      if (std::min({ix, iy, iz}) < 0 || std::max(ix, iy) >= g.voxels || iz >= g.slices) continue;
      const double weight = shown * ray.power * chord / kPlaces * std::exp(-alpha * along * chord);
      const std::size_t v =
          box.at(static_cast<int>(iz), static_cast<int>(iy), static_cast<int>(ix));
      sum[v] += weight;
      squares[v] += weight * weight;
    }
  }
  const double unit = dose_of_turn(g, bench.exposure) * job.turns * g.angles * p.width_px *
                      p.height_px * p.pixel_x_um * p.pixel_y_um * 1e-6 / count /
                      (g.voxel_mm() * g.voxel_mm() * height);
  for (std::size_t v = 0; v < voxels; ++v) {
    walked.dose.push_back(unit * sum[v]);
    walked.error.push_back(unit * std::sqrt(squares[v]));
  }
  return walked;
}

/// A printer whose image just covers a vial of 2 mm, so that rays are few.
inline Printer small_printer(bool dry, double pixel_mm) {
  Printer p = bench_printer();
  p.vial = dry ? Vial{2.25, 2.0, 1.0, 1.48} : Vial{2.25, 2.0, 1.5, 1.5};
  p.pixel_x_um = p.pixel_y_um = 1e3 * pixel_mm;
  p.width_px = 2 * static_cast<int>(std::ceil(2.3 / pixel_mm));
  p.height_px = 2 * static_cast<int>(std::ceil(1.0 / pixel_mm));
  p.calibration = {{0, 0}, {255, 2}};
  p.rotation->max_fps = 0;
  return p;
}

/// What rays say of `dose_of`, and how near.
struct Agreement {
  int within = 0, all = 0;  ///< voxels within the allowance
  double off = 0;           ///< of the whole dose
  double noise = 0;         ///< of that, by how few rays there are: four standard errors
};
/// `allowed`: of the largest dose, beside five standard errors.
inline Agreement agreement_of(const TomoJob& job, const Bench& bench, double allowed, int count) {
  const TomoGrid& g = bench.grid;
  const Walked want = walk(job, bench, count);
  const Box<float> got = dose_of(job);
  const double most = *std::max_element(want.dose.begin(), want.dose.end());
  Agreement a;
  double sum = 0;
  for (int z = 0; z < g.slices; ++z) {
    for (int y = 0; y < g.voxels; ++y) {
      for (int x = 0; x < g.voxels; ++x) {
        // Where light comes from all sides, and voxels lie within the resin.
        const double r = std::hypot(g.voxel_at_mm(x), g.voxel_at_mm(y)) + 0.75 * g.voxel_mm();
        if (r > std::min(bench.reach_mm, g.radius_mm)) continue;
        const std::size_t v = got.at(z, y, x);
        const double apart = std::abs(got.values[v] - want.dose[v]);
        a.off += got.values[v] - want.dose[v];
        sum += want.dose[v];
        ++a.all;
        a.within += apart < 5 * want.error[v] + allowed * most;
      }
    }
  }
  a.off /= sum;
  a.noise = 4 / std::sqrt(want.rays);
  return a;
}

/// A job of frames of this light. `light(m, column, row)`: a level.
template <class LightAt>
TomoJob job_of_light(const Printer& p, const Resin& resin, const Sampling& sampling,
                     const LightAt& light) {
  TomoJob job;
  job.printer = p;
  job.resin = resin;
  job.sampling = sampling;
  const Bench bench = make_bench(p, job.resin, job.sampling);
  const TomoGrid& g = bench.grid;
  job.part = {g.slices, g.voxels, g.voxels, {}};
  job.part.values.assign(static_cast<std::size_t>(g.slices * g.voxels * g.voxels), 0);
  job.levels.assign(g.blocks() * g.light_of_block(), 0);
  for (int m = 0; m < g.angles; ++m) {
    for (int i = 0; i < g.pixels; ++i) {
      for (int r = 0; r < g.light_rows(); ++r) {
        job.levels[g.pixel(m, i, r)] = static_cast<std::uint16_t>(light(m, i, r));
      }
    }
  }
  return job;
}

/// What `dose_of` says of frames of this light is what rays bring. `light(m, column, row)`: a level.
template <class LightAt>
void expect_rays_agree(const Printer& p, double voxel_mm, int slices, int angles,
                       const LightAt& light) {
  const TomoJob job = job_of_light(p, bench_resin(2), {voxel_mm, slices, angles}, light);
  const Bench bench = make_bench(p, job.resin, job.sampling);
  const Agreement a = agreement_of(job, bench, 0.015, 300000);
  // Footprints are right to 1 % and less of large weights; five standard errors for the rays.
  EXPECT_EQ(a.within, a.all);
  EXPECT_NEAR(a.off, 0, 0.01 + a.noise);
}

}  // namespace slicecorr::tomo
