// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "tomo/operators/ray_sources.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>

#include "parallel/silent.hpp"
#include "slicecorr/vial.hpp"

namespace slicecorr::tomo::detail {

namespace {

/// Nodes of the tables from the axis outwards: along t, where t is the reach times the sine of evenly
/// spaced angles, as rays bend most at grazing incidence; and along u.
constexpr int kAcross = 32, kAlong = 8;
/// Nodes along z are so many to the vial's radius.
constexpr int kUp = 8;
/// Newton's steps; it ends sooner where the place is met to this, mm.
constexpr int kSteps = 40;
constexpr double kMet = 1e-9;
/// Distance of lines that derivatives are taken between, mm.
constexpr double kApart = 1e-4;

/// What a line outside makes of t, and of z at u.
struct Met {
  double t = 0, z = 0;
  ResinRay ray;
  double half = 0, slope = 0;
};

}  // namespace

RaySources::RaySources(const Printer& printer, double n_resin, double alpha_per_mm,
                       double lowest_mm, double highest_mm, const ExecutionContext& context)
    : printer_(printer), n_(n_resin), alpha_(alpha_per_mm) {
  const Optics& optics = *printer.optics;
  points_ = aperture_points(optics.half_angle_deg > 0 ? optics.rays_per_pixel : 1);
  reach_ = aperture_slope(printer);
  const Vial& vial = *printer.vial;
  most_mm_ = most_in_resin_mm(vial, n_resin, vial.outside_mm());
  u_step_mm_ = vial.inner_mm / kAlong;
  const double height_mm = highest_mm - lowest_mm;
  heights_ = std::clamp(static_cast<int>(std::ceil(height_mm * kUp / vial.inner_mm)), 1, 512) + 1;
  lowest_mm_ = lowest_mm;
  height_step_mm_ = std::max(height_mm / (heights_ - 1), 1e-6);
  constexpr int kT = 2 * kAcross + 1, kU = 2 * kAlong + 1;
  tables_.resize(points_.size());
  for (Table& table : tables_) {
    table.nodes.resize(static_cast<std::size_t>(kT * kU) * static_cast<std::size_t>(heights_));
  }
  parallel_for(slicecorr::detail::silent(context), "", tables_.size() * kT, [&](std::size_t i) {
    const auto ray = static_cast<int>(i / kT), t = static_cast<int>(i % kT);
    Table& table = tables_[static_cast<std::size_t>(ray)];
    for (int u = 0; u < kU; ++u) {
      const RaySource* near = nullptr;
      for (int z = 0; z < heights_; ++z) {
        RaySource& node = table.nodes[at(t, u, z)];
        node =
            solve(ray, t_mm(t), u_step_mm_ * (u - kAlong), lowest_mm_ + height_step_mm_ * z, near);
        near = node.share > 0 ? &node : nullptr;
      }
    }
  });
}

double RaySources::t_mm(int i) const {
  return most_mm_ * std::sin(0.5 * std::numbers::pi * (i - kAcross) / kAcross);
}

std::size_t RaySources::at(int t, int u, int z) const {
  return (static_cast<std::size_t>(t) * (2 * kAlong + 1) + static_cast<std::size_t>(u)) *
             static_cast<std::size_t>(heights_) +
         static_cast<std::size_t>(z);
}

RaySource RaySources::solve(int ray, double t_mm, double u_mm, double z_mm,
                            const RaySource* near) const {
  if (!(std::abs(t_mm) < most_mm_)) return {};
  const Vial& vial = *printer_.vial;
  const AperturePoint point = points_[static_cast<std::size_t>(ray)];
  const auto meet = [&](double column, double row) -> std::optional<Met> {
    LightLine line = chief_ray(printer_, column, row);
    line.slope_x += point.x * reach_;
    line.slope_z += point.z * reach_;
    const std::optional<ResinRay> in = ray_in_resin(vial, n_, line);
    if (!in) return std::nullopt;
    Met met;
    met.ray = *in;
    const double flat = std::sqrt(1 - in->kz * in->kz);
    met.half = 0.5 * in->chord_mm * flat;
    met.slope = in->kz / flat;
    met.t = in->t_mm;
    met.z = in->entry_z_mm + met.slope * (u_mm + met.half);
    return met;
  };
  // Lines that miss are met halfway back.
  const double pitch_x = printer_.pixel_x_um * 1e-3, pitch_y = printer_.pixel_y_um * 1e-3;
  ImagePlace place = near ? ImagePlace{near->column, near->row}
                          : image_place(printer_, {0, z_mm / height_on_axis(printer_, n_)});
  std::optional<Met> now = meet(place.column, place.row);
  if (!now) return {};
  const double hc = kApart / pitch_x, hr = kApart / pitch_y;
  double det = 0, along = 0, up = 0;
  for (int step = 0;; ++step) {
    const auto right = meet(place.column + hc, place.row),
               left = meet(place.column - hc, place.row);
    const auto below = meet(place.column, place.row + hr),
               above = meet(place.column, place.row - hr);
    if (!right || !left || !below || !above) return {};
    // By X and Z: rows count downwards.
    const double tx = (right->t - left->t) / (2 * kApart), zx = (right->z - left->z) / (2 * kApart);
    const double tz = (above->t - below->t) / (2 * kApart),
                 zz = (above->z - below->z) / (2 * kApart);
    det = tx * zz - tz * zx;
    along = std::abs(zz / det) / pitch_x;
    up = std::abs(tx / det) / pitch_y;
    const double dt = t_mm - now->t, dz = z_mm - now->z;
    if (std::hypot(dt, dz) < kMet) break;
    if (step == kSteps || det == 0) return {};
    const double dx = (dt * zz - dz * tz) / det, dy = (dz * tx - dt * zx) / det;
    double share = 1;
    for (int halved = 0;; ++halved) {
      if (halved == 30) return {};
      const ImagePlace next{place.column + share * dx / pitch_x, place.row - share * dy / pitch_y};
      const auto there = meet(next.column, next.row);
      if (there && std::hypot(t_mm - there->t, z_mm - there->z) < std::hypot(dt, dz)) {
        place = next;
        now = there;
        break;
      }
      share *= 0.5;
    }
  }
  RaySource source;
  source.column = place.column;
  source.row = place.row;
  source.turn_rad = now->ray.turn_rad;
  source.along = along;
  source.up = up;
  source.slope = now->slope;
  const double stretch = std::sqrt(1 + now->slope * now->slope);
  source.way_mm = (now->half + u_mm) * stretch;
  source.spread =
      now->ray.transmittance * stretch / (std::abs(det) * static_cast<double>(points_.size()));
  source.share = source.spread * std::exp(-alpha_ * source.way_mm);
  return source;
}

void RaySources::along_z(int ray, double t_mm, double u_mm, double first_mm, double step_mm,
                         std::vector<RaySource>& places) const {
  if (!(std::abs(t_mm) < most_mm_)) {
    std::fill(places.begin(), places.end(), RaySource{});
    return;
  }
  const Table& table = tables_[static_cast<std::size_t>(ray)];
  const double ft = std::asin(t_mm / most_mm_) / (0.5 * std::numbers::pi) * kAcross + kAcross,
               fu = u_mm / u_step_mm_ + kAlong;
  const int t0 = std::clamp(static_cast<int>(std::floor(ft)), 0, 2 * kAcross - 1),
            u0 = std::clamp(static_cast<int>(std::floor(fu)), 0, 2 * kAlong - 1);
  const double wt = ft - t0, wu = fu - u0;
  // Quadratic along t, with the next node towards the axis.
  const int t2 = t0 >= kAcross ? t0 - 1 : t0 + 2;
  const auto blended = [&](int z, RaySource& out) {
    RaySource sum;
    for (const int b : {0, 1}) {
      const RaySource& n0 = table.nodes[at(t0, u0 + b, z)];
      const RaySource& n1 = table.nodes[at(t0 + 1, u0 + b, z)];
      const RaySource& n2 = table.nodes[at(t2, u0 + b, z)];
      if (!(n0.share > 0) || !(n1.share > 0) || !(n2.share > 0)) return false;
      // Lagrange through t0, t0 + 1 and t2.
      const double d2 = t2 - t0;
      const double l0 = (wt - 1) * (wt - d2) / d2, l1 = wt * (wt - d2) / (1 - d2),
                   l2 = wt * (wt - 1) / (d2 * (d2 - 1));
      const double w = b ? wu : 1 - wu;
      const auto add = [&](double RaySource::*part) {
        sum.*part += w * (l0 * n0.*part + l1 * n1.*part + l2 * n2.*part);
      };
      add(&RaySource::column);
      add(&RaySource::row);
      add(&RaySource::turn_rad);
      add(&RaySource::along);
      add(&RaySource::up);
      add(&RaySource::slope);
      add(&RaySource::way_mm);
      add(&RaySource::spread);
    }
    out = sum;
    return sum.spread > 0;
  };
  thread_local std::vector<RaySource> nodes;
  nodes.assign(static_cast<std::size_t>(heights_), {});
  bool smooth = true;
  for (int z = 0; z < heights_ && smooth; ++z) {
    smooth = blended(z, nodes[static_cast<std::size_t>(z)]);
  }
  const RaySource* near = nullptr;
  for (std::size_t k = 0; k < places.size(); ++k) {
    const double z_mm = first_mm + step_mm * static_cast<double>(k);
    if (!smooth) {
      places[k] = solve(ray, t_mm, u_mm, z_mm, near);
      near = places[k].share > 0 ? &places[k] : nullptr;
      continue;
    }
    const double fz = std::clamp((z_mm - lowest_mm_) / height_step_mm_, 0.0, heights_ - 1.0);
    const int z0 = std::min(static_cast<int>(fz), heights_ - 2);
    const double wz = fz - z0;
    const RaySource &a = nodes[static_cast<std::size_t>(z0)],
                    &b = nodes[static_cast<std::size_t>(z0) + 1];
    const auto between = [&](double RaySource::*part) { return (1 - wz) * a.*part + wz * b.*part; };
    places[k] = {
        between(&RaySource::column), between(&RaySource::row),    between(&RaySource::turn_rad),
        between(&RaySource::along),  between(&RaySource::up),     between(&RaySource::slope),
        between(&RaySource::way_mm), between(&RaySource::spread), 0};
    places[k].share = places[k].spread * std::exp(-alpha_ * places[k].way_mm);
  }
}

}  // namespace slicecorr::tomo::detail
