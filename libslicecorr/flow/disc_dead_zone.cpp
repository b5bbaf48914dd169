// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// The dead zone that light leaves in the long run, and what draws the resin into it.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "flow/disc_levels.hpp"
#include "flow/disc_march.hpp"
#include "flow/front_step.hpp"

namespace slicecorr {

namespace {

/// Share of the radius where the curve, of a gap, is at `largest`.
double share_at(const RadialCurve& gap, double largest) {
  double share = gap.value.front() >= largest ? gap.r.front() : 0;
  for (std::size_t i = 1; i < gap.r.size(); ++i) {
    if (gap.value[i - 1] >= largest && gap.value[i] >= largest) share += gap.r[i] - gap.r[i - 1];
  }
  return share;
}

void check_search(const DeadZoneSearch& search) {
  disc::check_positive(search.start_um, "start_um");
  disc::check_positive(search.largest_um, "largest_um");
  disc::check_positive(search.slope, "slope");
  disc::check_positive(search.settled_um, "settled_um");
  if (!(search.largest_um > search.start_um)) {
    disc::refuse("largest_um", fmt::format("is {}; expected more than the start, {} um",
                                           search.largest_um, search.start_um));
  }
  if (search.rounds < 1) {
    disc::refuse("rounds", fmt::format("is {}; expected 1 or more", search.rounds));
  }
}

/// The dose at h: that of the march in the gap hf, and what resin gains on its way up from there.
DiscDose dose_at_gap(const FlowResin& resin, const DiscPrint& print, const RadialCurve& gap_um,
                     const DiscLight& light, double slope, const DiscGrid& grid) {
  RadialCurve flow_um = gap_um;
  disc::limit_slope(gap_um.r, slope * 1e3 * print.radius_mm, flow_um.value);
  DiscDose dose = disc::march(resin, print, flow_um, {light}, grid).front();
  const Kinetics& k = resin.kinetics;
  const double unit = 1 / (disc::um_s(print.speed_mm_h) * k.critical_dose_prime);
  for (std::size_t i = 0; i < gap_um.r.size(); ++i) {
    if (flow_um.value[i] >= gap_um.value[i]) continue;
    const double blue = light.blue_mw_cm2.at(gap_um.r[i]), uv = light.uv_mw_cm2.at(gap_um.r[i]);
    dose.front.value[i] +=
        unit * disc::dose_integral(k, blue, uv, flow_um.value[i], gap_um.value[i]);
  }
  return dose;
}

}  // namespace

DiscDeadZone disc_dead_zone(const FlowResin& resin, const DiscPrint& print, const DiscLight& light,
                            const DeadZoneSearch& search, const DiscGrid& grid) {
  disc::check_resin(resin);
  disc::check_print(print);
  disc::check_grid(grid);
  disc::check_light(light);
  check_search(search);
  disc::check_inhibited(light);
  const double speed = disc::um_s(print.speed_mm_h);
  const disc::Places places = disc::make_places(print.shape, grid);
  DiscDeadZone zone;
  zone.gap_um = disc::as_curve(places, std::vector<double>(places.r.size(), search.start_um));
  const std::vector<double>& r = zone.gap_um.r;
  // Thinner than this the light is even over the gap, and h may not reach 0.
  const double least_um = 1e-3 * resin.kinetics.huv_um;
  for (int round = 0; round < search.rounds && !zone.settled; ++round) {
    zone.dose = dose_at_gap(resin, print, zone.gap_um, light, search.slope, grid);
    zone.last_change_um = 0;
    for (std::size_t i = 0; i < r.size(); ++i) {
      double& h = zone.gap_um.value[i];
      const double step =
          detail::front_step_um(resin.kinetics, speed, h, light.blue_mw_cm2.at(r[i]),
                                light.uv_mw_cm2.at(r[i]), zone.dose.front.value[i]);
      const double next = std::clamp(h + step, least_um, search.largest_um);
      zone.last_change_um = std::max(zone.last_change_um, std::abs(next - h));
      h = next;
    }
    zone.settled = zone.last_change_um <= search.settled_um;
  }
  zone.dose = dose_at_gap(resin, print, zone.gap_um, light, search.slope, grid);
  zone.adheres =
      *std::max_element(zone.dose.window.value.begin(), zone.dose.window.value.end()) >= 1;
  zone.void_share = share_at(zone.gap_um, search.largest_um);
  return zone;
}

DiscSuction disc_suction(const FlowResin& resin, const DiscPrint& print, const RadialCurve& gap_um,
                         double limit_pa) {
  disc::check_resin(resin);
  disc::check_print(print);
  disc::check_gap(gap_um);
  if (!(limit_pa > 0 && limit_pa <= kCavitationPa)) {
    disc::refuse("suction_limit_pa",
                 fmt::format("is {}; expected more than 0, and at most {} (1 bar)", limit_pa,
                             kCavitationPa));
  }
  const bool round = print.shape == DiscShape::disc;
  const double rp = 1e-3 * print.radius_mm, speed = 1e-6 * disc::um_s(print.speed_mm_h);
  // dp/dx = 12 mu Q/h^3 over pieces on which 1/h^3 is taken at their ends and their middle (Simpson's
  // rule, exact for an even gap), from the edge inwards. The force is the integral of p dA, by parts
  // that of dp/dx times the area within, pi x^2 or 2 x.
  const double flow = 12 * resin.viscosity_pa_s * speed / (round ? 2 : 1);
  const double area = round ? 3.14159265358979323846 : 2 * 1e-3;
  const double power = round ? 2 : 1;
  const auto slope = [&](double r) { return flow * rp * r / std::pow(1e-6 * gap_um.at(r), 3); };
  std::vector<double> bounds{0, 1};
  // Pieces short enough for gaps that change, too.
  constexpr int pieces = 256;
  for (int i = 1; i < pieces; ++i) bounds.push_back(static_cast<double>(i) / pieces);
  bounds.insert(bounds.end(), gap_um.r.begin(), gap_um.r.end());
  std::sort(bounds.begin(), bounds.end());
  DiscSuction s;
  for (std::size_t i = 1; i < bounds.size(); ++i) {
    const double r0 = bounds[i - 1], r1 = bounds[i], middle = 0.5 * (r0 + r1);
    const double weight = rp * (r1 - r0) / 6;
    const auto within = [&](double r) { return area * std::pow(rp * r, power); };
    s.most_pa += weight * (slope(r0) + 4 * slope(middle) + slope(r1));
    s.force_n += weight * (slope(r0) * within(r0) + 4 * slope(middle) * within(middle) +
                           slope(r1) * within(r1));
  }
  s.rim_mm_s = 1e3 * flow / (12 * resin.viscosity_pa_s) * rp / (1e-6 * gap_um.at(1));
  s.flow_mm3_s = 1e9 * speed * area * std::pow(rp, power);
  s.fastest_mm_h = print.speed_mm_h * limit_pa / s.most_pa;
  return s;
}

double part_takes_over_um(double platform_radius_mm, double part_radius_mm, double gap_um) {
  disc::check_positive(platform_radius_mm, "platform_radius_mm");
  disc::check_positive(part_radius_mm, "part_radius_mm");
  disc::check_positive(gap_um, "gap_um");
  return gap_um * std::pow(platform_radius_mm / part_radius_mm, 4.0 / 3);
}

}  // namespace slicecorr
