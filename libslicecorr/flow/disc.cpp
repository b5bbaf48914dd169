// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// What the header promises, checked, around the march.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "flow/disc_levels.hpp"
#include "flow/disc_march.hpp"
#include "slicecorr/error.hpp"

namespace slicecorr {

namespace disc {

void refuse(const std::string& key, const std::string& what) {
  throw InputError("resin flow", key, what);
}

void check_positive(double value, const std::string& key) {
  if (!(value > 0) || !std::isfinite(value)) {
    refuse(key, fmt::format("is {}; expected a number above 0", value));
  }
}

void check_resin(const FlowResin& resin) {
  const Kinetics& k = resin.kinetics;
  check_positive(resin.viscosity_pa_s, "viscosity_pa_s");
  check_positive(k.hb_um, "absorbance_height_um");
  check_positive(k.m, "m");
  check_positive(k.critical_dose_prime, "critical_dose_prime");
  if (!(resin.diffusion_m2_s >= 0) || !std::isfinite(resin.diffusion_m2_s)) {
    refuse("dose_diffusion_m2_s", fmt::format("is {}; expected 0 or more", resin.diffusion_m2_s));
  }
  if (!(resin.inhibitor_life_s >= 0)) {
    refuse("inhibitor_life_s",
           fmt::format("is {}; expected 0 or more, or inf", resin.inhibitor_life_s));
  }
  if (!(k.beta > 0)) {
    throw InfeasibleError(
        "resin flow: the resin has no inhibition by UV light, so that there is no dead zone to flow "
        "in: it adheres to the window at once");
  }
  if (!(k.huv_um > 0 && k.huv_um < k.hb_um)) {
    refuse(
        "inhibition.absorbance_height_um",
        fmt::format("is {} um, base e; expected it above 0 and below that of the blue light, {} um",
                    k.huv_um, k.hb_um));
  }
}

void check_print(const DiscPrint& print) {
  check_positive(print.radius_mm, "radius_mm");
  check_positive(print.speed_mm_h, "speed_mm_h");
}

void check_grid(const DiscGrid& grid) {
  if (grid.levels < 4 || grid.levels > 4096) {
    refuse("levels", fmt::format("is {}; expected 4 to 4096", grid.levels));
  }
  if (grid.steps < 4 || grid.steps > 100000) {
    refuse("steps", fmt::format("is {}; expected 4 to 100000", grid.steps));
  }
  if (!(grid.least_r > 0 && grid.least_r < 1)) {
    refuse("least_r", fmt::format("is {}; expected it between 0 and 1", grid.least_r));
  }
}

namespace {

void check_curve(const RadialCurve& curve, const std::string& key) {
  if (curve.r.empty() || curve.r.size() != curve.value.size()) {
    refuse(key, fmt::format("has {} places and {} values; expected as many of both, 1 or more",
                            curve.r.size(), curve.value.size()));
  }
  for (std::size_t i = 0; i < curve.r.size(); ++i) {
    if (!(curve.r[i] >= 0 && curve.r[i] <= 1) || (i > 0 && !(curve.r[i] > curve.r[i - 1]))) {
      refuse(key,
             fmt::format("place {} is {}; expected places from 0 to 1 that ascend", i, curve.r[i]));
    }
  }
}

void check_intensity(const RadialCurve& curve, const std::string& key) {
  check_curve(curve, key);
  for (const double v : curve.value) {
    if (!(v >= 0) || !std::isfinite(v)) {
      refuse(key, fmt::format("has {}; expected 0 mW/cm² or more", v));
    }
  }
}

}  // namespace

void check_gap(const RadialCurve& gap_um) {
  check_curve(gap_um, "gap_um");
  for (const double h : gap_um.value) check_positive(h, "gap_um");
}

void check_inhibited(const DiscLight& light) {
  const std::vector<double>& uv = light.uv_mw_cm2.value;
  if (*std::max_element(uv.begin(), uv.end()) > 0) return;
  throw InfeasibleError(
      "resin flow: without UV light there is no dead zone: the part adheres to the window at once");
}

void check_front(const RadialCurve& front) { check_curve(front, "front"); }

void check_light(const DiscLight& light) {
  check_intensity(light.blue_mw_cm2, "blue_mw_cm2");
  check_intensity(light.uv_mw_cm2, "uv_mw_cm2");
}

}  // namespace disc

double RadialCurve::at(double place) const {
  const auto above = std::upper_bound(r.begin(), r.end(), place);
  if (above == r.begin()) return value.front();
  if (above == r.end()) return value.back();
  const auto i = static_cast<std::size_t>(above - r.begin());
  const double part = (place - r[i - 1]) / (r[i] - r[i - 1]);
  return value[i - 1] + part * (value[i] - value[i - 1]);
}

RadialCurve even_curve(double value) { return {{0, 1}, {value, value}}; }

DiscLight even_light(double blue_mw_cm2, double uv_mw_cm2) {
  return {even_curve(blue_mw_cm2), even_curve(uv_mw_cm2)};
}

DiscDose disc_dose(const FlowResin& resin, const DiscPrint& print, const RadialCurve& gap_um,
                   const DiscLight& light, const DiscGrid& grid) {
  disc::check_resin(resin);
  disc::check_print(print);
  disc::check_grid(grid);
  disc::check_gap(gap_um);
  disc::check_light(light);
  return disc::march(resin, print, gap_um, {light}, grid).front();
}

std::vector<DiscDose> disc_doses(const FlowResin& resin, const DiscPrint& print,
                                 const RadialCurve& gap_um, const std::vector<DiscLight>& lights,
                                 const DiscGrid& grid) {
  disc::check_resin(resin);
  disc::check_print(print);
  disc::check_grid(grid);
  disc::check_gap(gap_um);
  for (const DiscLight& light : lights) disc::check_light(light);
  if (!disc::is_linear(resin) && resin.inhibitor_life_s > 0) {
    disc::refuse("inhibitor_life_s",
                 "lights are marched together where Y is signed (inf) with m = 1, or clamped (0)");
  }
  return disc::march(resin, print, gap_um, lights, grid);
}

double still_dose(const FlowResin& resin, double speed_mm_h, double gap_um, double blue_mw_cm2,
                  double uv_mw_cm2, bool clamped) {
  disc::check_resin(resin);
  disc::check_positive(speed_mm_h, "speed_mm_h");
  disc::check_positive(gap_um, "gap_um");
  disc::check_light(even_light(blue_mw_cm2, uv_mw_cm2));
  if (resin.kinetics.m != 1) disc::refuse("m", "the dose of still resin is told for m = 1");
  const auto integral = clamped ? disc::clamped_integral : disc::rate_integral;
  return integral(resin.kinetics, blue_mw_cm2, uv_mw_cm2, 0, gap_um) /
         (disc::um_s(speed_mm_h) * resin.kinetics.critical_dose_prime);
}

}  // namespace slicecorr
