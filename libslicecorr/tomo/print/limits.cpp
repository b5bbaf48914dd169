// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/tomo/limits.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <nlohmann/json.hpp>
#include <numbers>

#include "slicecorr/error.hpp"
#include "slicecorr/tomo/bench.hpp"
#include "slicecorr/vial.hpp"
#include "tomo/operators/traced_light.hpp"

namespace slicecorr::tomo {

namespace {

constexpr double kDegree = std::numbers::pi / 180;

void check_asked(const LimitsAsked& a) {
  const auto refuse = [](const char* what, double value) {
    throw InputError(fmt::format("{} is {:g}; expected a number above 0", what, value));
  };
  for (const auto& [name, value] : {std::pair{"radius", a.radius_mm}, {"voxel", a.voxel_mm}}) {
    if (!(value >= 0 && value <= 1e6)) refuse(name, value);
  }
  if (!(a.density_g_cm3 > 0)) refuse("density", a.density_g_cm3);
  if (!(a.epsilon_per_m_cm >= 0)) refuse("molar absorption", a.epsilon_per_m_cm);
  if (!(a.molar_mass_g >= 0)) refuse("molar mass", a.molar_mass_g);
  if ((a.epsilon_per_m_cm > 0) != (a.molar_mass_g > 0)) {
    throw InputError("a recipe takes molar absorption and molar mass; expected both");
  }
}

/// How wide voxels are by which the resin is looked at, of its radius; and light below this share of even
/// light is none.
constexpr double kLookedAt = 1.0 / 40, kDark = 0.02;
constexpr int kTurnedByDeg = 5;

std::vector<LitAt> lit_at(const Printer& printer, const Resin& resin) {
  // Walls and rods count, absorption does not.
  // Slices that share light are two at least.
  Sampling sampling{printer.vial->inner_mm * kLookedAt, slices_share_light(printer, resin) ? 2 : 1,
                    3};
  Printer seen = printer;
  seen.rotation->max_fps = 0;
  // In the middle of the image, wherever that is.
  sampling.middle_z_mm = pixel_z_mm(printer, 0.5 * (printer.height_px - 1));
  if (sampling.voxel_mm < seen.pixel_y_um * 1e-3) sampling.voxel_mm = seen.pixel_y_um * 1e-3;
  const Bench bench = make_bench(seen, resin, sampling);
  const TomoGrid& g = bench.grid;
  const detail::TracedLight& light = *bench.traced;
  const detail::TracedStrips strips(g, light, g.voxel_mm(), 0);
  const detail::TracedBundle bundle = light.bundles[light.bundles.size() / 2];
  const auto n = static_cast<std::size_t>(g.voxels);
  std::vector<LitAt> all;
  for (int deg = 0; deg < 360; deg += kTurnedByDeg) {
    const double th = deg * kDegree;
    LitAt at;
    at.turned_deg = deg;
    std::vector<double> sum(n * n);
    int met = 0, reflected = 0;
    for (int i = 0; i < g.pixels; ++i) {
      strips.of_pixel(th, i, bundle, [&](const detail::TracedShare& s) {
        sum[static_cast<std::size_t>(s.y) * n + static_cast<std::size_t>(s.x)] += s.share;
      });
      detail::TracedRay ray;
      light.vial.trace(th, light.line(i, bundle), ray);
      met += ray.reflected || !ray.pieces.empty();
      reflected += ray.reflected;
    }
    const double alpha = light.vial.alpha_per_mm();
    int is = 0, lit = 0;
    at.dark_from_mm = std::numeric_limits<double>::infinity();
    for (std::size_t v = 0; v < n * n; ++v) {
      if (!light.resin[v]) continue;
      ++is;
      const double x = g.voxel_at_mm(static_cast<int>(v % n)),
                   y = g.voxel_at_mm(static_cast<int>(v / n));
      // As dim as light from the far side of the resin.
      if (sum[v] > kDark * std::exp(-2 * alpha * bench.radius_mm)) {
        ++lit;
      } else {
        at.dark_from_mm = std::min(at.dark_from_mm, std::hypot(x, y));
      }
    }
    at.lit = is > 0 ? static_cast<double>(lit) / is : 0;
    if (lit == is) at.dark_from_mm = 0;
    at.reflected = met > 0 ? static_cast<double>(reflected) / met : 0;
    all.push_back(at);
  }
  return all;
}

/// Up to where light of all directions reaches.
double reach_of(const Limits& l, const Printer& printer, double n_resin) {
  if (!printer.vial->traced()) {
    return std::min(reach_mm(printer, n_resin), printer.vial->inner_mm);
  }
  double least = printer.vial->inner_mm;
  for (const LitAt& at : l.turned) {
    if (at.dark_from_mm > 0) least = std::min(least, at.dark_from_mm);
  }
  return least;
}

}  // namespace

Limits limits_of(const Printer& printer, const Resin& resin, const LimitsAsked& asked) {
  require_tomographic(printer);
  check_asked(asked);
  const Vial& vial = *printer.vial;
  const double n = index_of(resin);
  // Flat walls do not magnify.
  const double magnified = vial.shape == VialShape::round ? vial.n_outside / n : 1;
  Limits l;
  if (vial.traced()) l.turned = lit_at(printer, resin);
  const double reach = reach_of(l, printer, n);
  l.radius_mm = asked.radius_mm > 0 ? asked.radius_mm : reach;
  if (l.radius_mm > reach * (1 + 1e-9)) {
    throw InputError(fmt::format(
        "a part of {:g} mm radius, where light of all directions reaches {:.3f} mm; expected a "
        "smaller one",
        l.radius_mm, reach));
  }
  const double pixel = printer.pixel_x_um * 1e-3 * magnified,
               row = printer.pixel_y_um * 1e-3 * (vial.traced() ? 1 : height_on_axis(printer, n));
  const double voxel = asked.voxel_mm > 0 ? asked.voxel_mm : printer.pixel_y_um * 1e-3;
  const int shown = most_frames_per_turn(*printer.rotation);
  l.angles = asked.angles > 0 ? asked.angles
             : shown > 0      ? shown
                              : resolving_angles(l.radius_mm, voxel);
  l.widths = {{"voxel", voxel},
              {"pixel", pixel},
              {"row", row},
              {"turn", 2 * std::numbers::pi * l.radius_mm / l.angles}};
  const double half = printer.optics->half_angle_deg * kDegree;
  // A cone that is as wide as what a pixel leaves of a voxel, on both sides of the focus.
  const double slope = std::max(0.0, voxel - pixel) / (2 * l.radius_mm);
  const double sine = std::min(1.0, std::sin(std::atan(slope)) / magnified);
  l.most_half_angle_deg = std::asin(sine) / kDegree;
  if (half > 0) {
    const double in_resin = std::asin(std::min(1.0, std::sin(half) * magnified));
    l.half_angle_deg = in_resin / kDegree;
    l.numerical_aperture = vial.n_outside * std::sin(half);
    l.widths.push_back({"aperture", 2 * l.radius_mm * std::tan(in_resin)});
    l.widths.push_back({"wave", printer.wavelength_nm * 1e-6 / (2 * l.numerical_aperture)});
    l.light_share = sine * sine / (std::sin(half) * std::sin(half));
  }
  std::stable_sort(l.widths.begin(), l.widths.end(),
                   [](const Limit& a, const Limit& b) { return a.mm > b.mm; });
  const double alpha = absorption_per_mm(resin);
  l.alpha_r = alpha * vial.inner_mm;
  l.best_absorption_per_cm = 10 / vial.inner_mm;
  if (asked.epsilon_per_m_cm > 0) {
    const auto grams = [&](double per_cm) {
      const double mol_l =
          (per_cm - asked.without_per_cm) / (std::numbers::ln10 * asked.epsilon_per_m_cm);
      return mol_l * asked.molar_mass_g / asked.density_g_cm3;
    };
    l.grams_per_kg = grams(l.best_absorption_per_cm);
    l.grams_now = grams(10 * alpha);
  }
  return l;
}

std::string Limits::to_json() const {
  nlohmann::ordered_json j;
  j["radius_mm"] = radius_mm;
  j["angles"] = angles;
  j["limited_by"] = widths.front().name;
  for (const Limit& w : widths) j["widths_mm"][std::string(w.name)] = w.mm;
  j["half_angle_deg"] = half_angle_deg;
  j["numerical_aperture"] = numerical_aperture;
  j["most_half_angle_deg"] = most_half_angle_deg;
  j["light_share"] = light_share;
  j["alpha_r"] = alpha_r;
  j["best_absorption_per_cm"] = best_absorption_per_cm;
  if (grams_per_kg != 0 || grams_now != 0) {
    j["initiator_g_per_kg"] = {{"best", grams_per_kg}, {"now", grams_now}};
  }
  for (const LitAt& at : turned) {
    j["turned"].push_back({{"turned_deg", at.turned_deg},
                           {"lit", at.lit},
                           {"dark_from_mm", at.dark_from_mm},
                           {"reflected", at.reflected}});
  }
  return j.dump(2);
}

}  // namespace slicecorr::tomo
