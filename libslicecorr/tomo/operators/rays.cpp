// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/tomo/rays.hpp"

#include <fmt/format.h>

#include <cmath>
#include <numbers>
#include <optional>

#include "slicecorr/error.hpp"
#include "slicecorr/vial.hpp"

namespace slicecorr::tomo {

namespace {

using std::numbers::pi;

/// Hexagonal cells: one in the middle, six around it, and the six between these, sqrt 3 cells away.
/// All 13 together have the area of the disc.
std::vector<AperturePoint> hexagon() {
  // A hexagonal cell of pitch a has sqrt(3)/2 a^2; 13 of them make pi.
  const double pitch = std::sqrt(2 * pi / (13 * std::sqrt(3.0)));
  std::vector<AperturePoint> points = {{0, 0}};
  for (const bool far : {false, true}) {
    for (int k = 0; k < 6; ++k) {
      const double angle = pi / 3 * (k + (far ? 0.5 : 0.0));
      const double r = pitch * (far ? std::sqrt(3.0) : 1.0);
      points.push_back({r * std::cos(angle), r * std::sin(angle)});
    }
  }
  return points;
}

}  // namespace

std::vector<AperturePoint> aperture_points(int rays) {
  if (rays < 1 || rays > 1000) {
    throw InputError(fmt::format("{} rays per pixel; expected 1 to 1000", rays));
  }
  if (rays == 1) return {{0, 0}};
  if (rays == 13) return hexagon();
  // Golden angle between points, each in the middle of its ring's area.
  std::vector<AperturePoint> points;
  const double golden = pi * (3 - std::sqrt(5.0));
  for (int k = 0; k < rays; ++k) {
    const double r = std::sqrt((k + 0.5) / rays);
    points.push_back({r * std::cos(golden * k), r * std::sin(golden * k)});
  }
  return points;
}

LabRays lab_rays(const Printer& printer, double n_resin, double alpha_per_mm,
                 const PixelWindow& window) {
  require_tomographic(printer);
  const Vial& vial = *printer.vial;
  const Optics& optics = *printer.optics;
  // Beside an image of one row there is a dark one.
  const int least_row = printer.height_px > 1 ? 0 : -1;
  if (window.wide < 1 || window.high < 1 || window.columns < 1 || window.rows < 1 ||
      window.first_column < 0 || window.first_row < least_row ||
      window.first_column + window.columns * window.wide > printer.width_px ||
      window.first_row + window.rows * window.high > printer.height_px) {
    throw InputError("printer '" + printer.name + "': the window of pixels reaches over its image");
  }
  LabRays all;
  all.columns = window.columns;
  all.rows = window.rows;
  all.pixel_area_mm2 = printer.pixel_x_um * printer.pixel_y_um * 1e-6 * window.wide * window.high;
  all.alpha_per_mm = alpha_per_mm;
  all.vial_mm = vial.inner_mm;
  if (window.wide == 1) all.across.lit = std::sqrt(printer.fill_factor);
  if (window.high == 1) all.up.lit = std::sqrt(printer.fill_factor);
  const bool spread = optics.half_angle_deg > 0;
  const std::vector<AperturePoint> points = aperture_points(spread ? optics.rays_per_pixel : 1);
  all.per_pixel = static_cast<int>(points.size());
  const double reach = aperture_slope(printer);
  const double share = 1.0 / static_cast<double>(points.size());
  all.rays.reserve(static_cast<std::size_t>(all.columns) * static_cast<std::size_t>(all.rows) *
                   points.size());
  for (int c = 0; c < window.columns; ++c) {
    for (int r = 0; r < window.rows; ++r) {
      const int row = window.rows - 1 - r;
      const LightLine chief = chief_ray(printer, window.column_of(c), window.row_of(row));
      for (const AperturePoint& p : points) {
        // In focus on the plane Y = 0: all rays of a pixel meet there.
        LightLine line = chief;
        line.slope_x += p.x * reach;
        line.slope_z += p.z * reach;
        LabRay ray;
        if (const std::optional<ResinRay> in = ray_in_resin(vial, n_resin, line)) {
          const double flat = std::sqrt(1 - in->kz * in->kz);
          ray.turn_rad = in->turn_rad;
          ray.t_mm = in->t_mm;
          ray.half_mm = 0.5 * in->chord_mm * flat;
          ray.entry_z_mm = in->entry_z_mm;
          ray.slope = in->kz / flat;
          ray.power = share * in->transmittance;
        }
        all.rays.push_back(ray);
      }
    }
  }
  return all;
}

}  // namespace slicecorr::tomo
