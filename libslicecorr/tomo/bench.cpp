#include "slicecorr/tomo/bench.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "slicecorr/cure.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/vial.hpp"
#include "tomo/rays.hpp"

namespace slicecorr::tomo {

namespace {

constexpr double kSame = 1e-9;

[[noreturn]] void wrong(const Printer& printer, const std::string& what) {
  throw InputError("printer '" + printer.name + "': " + what);
}

}  // namespace

detail::RayAt detail::ray_at(const Vial& vial, double n_resin, double q_mm, double alpha_per_mm,
                             double radius_mm) {
  if (misses(vial, n_resin, q_mm, 0)) return {};
  const double magnified = n_resin / vial.n_outside, t = q_mm / magnified;
  const double beyond = std::sqrt(std::max(0.0, vial.inner_mm * vial.inner_mm - t * t)) -
                        std::sqrt(std::max(0.0, radius_mm * radius_mm - t * t));
  return {transmittance(vial, n_resin, q_mm, 0) * magnified * std::exp(-alpha_per_mm * beyond),
          turned_rad(vial, n_resin, q_mm, 0)};
}

int voxels_across(const Printer& printer, double voxel_mm) {
  require_tomographic(printer);
  const double radius_mm = printer.vial->inner_mm;
  const double half = std::floor(radius_mm / voxel_mm + kSame);
  if (!(half >= 1) || half > 8000) {
    throw InputError(fmt::format(
        "voxels of {:g} mm in resin of {:g} mm radius; expected 1 to 8000 from axis to wall",
        voxel_mm, radius_mm));
  }
  return 2 * static_cast<int>(half) + 1;
}

int resolving_angles(double radius_mm, double voxel_mm) {
  return static_cast<int>(
      std::min(std::ceil(2 * std::numbers::pi * radius_mm / voxel_mm - kSame), 1e9));
}

int usual_angles(const Printer& printer, double part_radius_mm, double voxel_mm) {
  constexpr int least = 180, most = 1440;
  int angles = std::clamp(resolving_angles(part_radius_mm, voxel_mm), least, most);
  const int shown = most_frames_per_turn(*printer.rotation);
  if (shown > 0) angles = std::min(angles, shown);
  return std::max(3, angles);
}

Bench make_bench(const Printer& printer, const Resin& resin, const Sampling& sampling) {
  require_tomographic(printer);
  const Vial& vial = *printer.vial;
  const Optics& optics = *printer.optics;
  if (optics.kind != OpticsKind::telecentric || optics.half_angle_deg > 0) {
    wrong(printer,
          "its light is not parallel, so that slices light each other; expected telecentric optics "
          "with a half angle of 0");
  }
  Bench b;
  const double n = index_of(resin);
  const double pitch_mm = printer.pixel_x_um * 1e-3, row_mm = printer.pixel_y_um * 1e-3;
  if (sampling.voxel_mm < row_mm * (1 - kSame)) {
    wrong(printer,
          fmt::format("its rows are {:g} mm high; expected voxels of at least that, not of "
                      "{:g} mm",
                      row_mm, sampling.voxel_mm));
  }
  if (sampling.angles < 3) {
    throw InputError(fmt::format("{} angles; expected at least 3", sampling.angles));
  }
  const int most_frames = most_frames_per_turn(*printer.rotation);
  if (most_frames > 0 && sampling.angles > most_frames) {
    wrong(printer,
          fmt::format("shows {} frames in a turn at most, not {}; expected fewer angles, or "
                      "a slower turn",
                      most_frames, sampling.angles));
  }
  b.radius_mm = vial.inner_mm;
  b.reach_mm = slicecorr::reach_mm(printer, n);
  b.clockwise = printer.rotation->direction == TurnDirection::clockwise;
  b.frame_width = printer.width_px;
  b.frame_height = printer.height_px;

  TomoGrid& grid = b.grid;
  grid.voxels = voxels_across(printer, sampling.voxel_mm);
  grid.radius_mm = 0.5 * sampling.voxel_mm * (grid.voxels - 1);
  grid.slices = sampling.slices;
  grid.angles = sampling.angles;
  grid.pixel_mm = pitch_mm * vial.n_outside / n;
  // Columns whose light may meet a voxel, one more to each side.
  // Where the axis does not keep to its place, as many more as it goes astray.
  const auto line_mm = [&](double column) {
    return pixel_x_mm(printer, column) * vial.n_outside / n;
  };
  const double tilt = optics.tilt_deg * std::numbers::pi / 180;
  const double astray_px =
      most_wobble_px(*printer.rotation) +
      0.5 * sampling.voxel_mm * sampling.slices / pitch_mm * std::abs(std::sin(tilt)) +
      printer.width_px * (1 - std::cos(tilt));
  int first = 0, past = printer.width_px;
  while (first < past && line_mm(first + 1 + astray_px) < -grid.radius_mm) ++first;
  while (past > first && line_mm(past - 2 - astray_px) > grid.radius_mm) --past;
  b.reach_mm = std::min(
      {b.reach_mm, -line_mm(astray_px - kSame), line_mm(printer.width_px - 1 - astray_px + kSame)});
  b.reach_mm = std::max(0.0, b.reach_mm);
  grid.pixels = past - first;
  b.first_column = first;
  if (grid.pixels < 2) wrong(printer, "none of its pixels meets the resin");
  grid.check();

  RayTables& rays = b.rays;
  rays.alpha_per_mm = absorption_per_mm(resin);
  b.alpha_r = rays.alpha_per_mm * b.radius_mm;
  for (int i = 0; i < grid.pixels; ++i) {
    const double q = pixel_x_mm(printer, first + i), t = line_mm(first + i);
    rays.line_mm.push_back(t);
    const detail::RayAt ray = detail::ray_at(vial, n, q, rays.alpha_per_mm, grid.radius_mm);
    rays.weight.push_back(ray.weight);
    rays.turn_rad.push_back(ray.turn_rad);
  }

  // Empty tables leave the operators their shorter ways.
  const auto all_near = [](const std::vector<double>& table, auto expected) {
    for (std::size_t i = 0; i < table.size(); ++i) {
      if (std::abs(table[i] - expected(static_cast<int>(i))) > kSame) return false;
    }
    return true;
  };
  if (all_near(rays.line_mm, [&](int i) { return grid.pixel_at_mm(i); })) rays.line_mm.clear();
  if (all_near(rays.turn_rad, [](int) { return 0.0; })) rays.turn_rad.clear();
  if (all_near(rays.weight, [](int) { return 1.0; })) rays.weight.clear();

  b.places = FramePlaces(printer, sampling, first, grid.pixels, b.clockwise);
  // What all angles light, at both ends of the rows.
  std::vector<bool> lit(static_cast<std::size_t>(sampling.slices), true);
  for (int m = 0; m < (b.places.moved() ? grid.angles : 1); ++m) {
    for (const int column : {0, grid.pixels - 1}) {
      std::vector<bool> here(lit.size(), false);
      for (int row = 0; row < printer.height_px; ++row) {
        const int s = b.places.slice_of(m, column, row);
        if (s >= 0) here[static_cast<std::size_t>(s)] = true;
      }
      for (std::size_t s = 0; s < lit.size(); ++s) lit[s] = lit[s] && here[s];
    }
  }
  if (std::find(lit.begin(), lit.end(), false) != lit.end()) {
    wrong(
        printer,
        fmt::format("its image is {:g} mm high about the optical axis at {:g} mm from its middle; "
                    "expected the {:g} mm of the part in it",
                    printer.height_px * row_mm, optics.axis_up_px * row_mm,
                    sampling.slices * sampling.voxel_mm));
  }

  b.mw_cm2 = level_intensities(printer);
  if (!(b.mw_cm2.back() > b.mw_cm2.front())) {
    wrong(printer,
          fmt::format("its brightest level shows {:g} mW/cm², its darkest {:g}; expected a "
                      "calibration that rises",
                      b.mw_cm2.back(), b.mw_cm2.front()));
  }
  if (b.places.uneven()) {
    for (int i = 0; i < grid.pixels; ++i) {
      for (int z = 0; z < grid.slices; ++z) {
        if (misses(vial, n, pixel_x_mm(printer, first + i), 0)) continue;
        if (b.places.share(0, i, z) > 0) continue;
        wrong(
            printer,
            fmt::format("its flat-field is black in column {}, {:.3f} mm from the optical axis, "
                        "where the resin is; expected some light",
                        first + i,
                        -0.5 * sampling.voxel_mm * (sampling.slices - 1) + sampling.voxel_mm * z));
      }
    }
  }
  b.exposure.alpha_a_per_cm = curing_absorption_per_mm(resin) * 10;
  b.exposure.turn_s = printer.rotation->turn_s();
  b.exposure.critical_mj_cm3 = dose_to_gel_mj_cm3(resin);
  b.exposure.black_mw_cm2 = b.mw_cm2.front();
  b.resupply_mj_cm3_s = resin.inhibition_resupply_mj_cm3_s;
  return b;
}

}  // namespace slicecorr::tomo
