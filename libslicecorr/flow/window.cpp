// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <vector>

#include "flow/need.hpp"
#include "flow/peel.hpp"
#include "flow/rubber.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/flow_window.hpp"
#include "support/numbers/bracket.hpp"

namespace slicecorr {

namespace {

/// A disc of the section's area, in metres, pascals and newtons.
struct SiDisc {
  double radius = 0, suction = 0, gap = 0, speed = 0;
  /// Of a disc with the section's force: its suction is 2 F/A in the middle, and falls to the outline as
  /// 1 - x². What bends a film is the whole of it.
  double even_suction = 0;
};

SiDisc disc_of(const FlowWindow& w, const PulledSection& s) {
  check_window(w);
  const SiDisc d{s.radius_mm() * 1e-3, s.suction_pa, s.gap_um * 1e-6, s.speed_mm_h / 3.6e6,
                 2 * s.force_n / (s.area_mm2 * 1e-6)};
  if (w.film_n_m > 0 && !(w.film_radius_mm > s.radius_mm())) {
    throw InputError(fmt::format(
        "the film is free over a radius of {:g} mm, and a disc of the section's area has {:.4g} mm; "
        "expected a film that reaches beyond the part",
        w.film_radius_mm, s.radius_mm()));
  }
  return d;
}

/// k of the slowest mode of a film under a disc, lap² w = k⁴ w with lap w = 0 at the outline, beside which the
/// film goes on to its frame. Its time is 12 mu R⁴/(k⁴ T h³).
double slowest_mode(double span_ratio) {
  const double log_span = std::log(span_ratio);
  const auto at = [&](double k) {
    const double j0 = std::cyl_bessel_j(0.0, k), j1 = std::cyl_bessel_j(1.0, k);
    return 2 * j0 +
           log_span * k * (j0 * std::cyl_bessel_i(1.0, k) / std::cyl_bessel_i(0.0, k) - j1);
  };
  // At 0 it is 2; at the first zero of J0 only the falling part is left.
  return halved({1e-6, 2.404825557695773}, 60, [&](double k) { return at(k) > 0; }).middle();
}

detail::Softness softness_of(const FlowWindow& w, const PulledSection& s, const SiDisc& d) {
  detail::Softness soft;
  soft.springs = w.springs_um_per_kpa * 1e-9 * d.suction / d.gap;
  if (w.film_n_m > 0) {
    soft.film = d.suction * d.radius * d.radius / (w.film_n_m * d.gap);
    soft.span_ratio = w.film_radius_mm / s.radius_mm();
    soft.stretch = w.film_stretch_n_m * d.gap * d.gap / (d.radius * d.radius * w.film_n_m);
  }
  if (w.rubber_mm > 0) {
    soft.rubber = d.suction * d.radius / (w.rubber_mpa * 1e6 / 3 * d.gap);
    soft.thickness = w.rubber_mm / s.radius_mm();
  }
  if (w.arm_n_mm > 0) soft.arm = s.force_n / (w.arm_n_mm * 1e3 * d.gap);
  return soft;
}

/// Under the suction of a disc, 1 - x², by rings that get narrower towards the outline.
void rest_on_rubber(const FlowWindow& w, const PulledSection& s, const SiDisc& d,
                    WindowRest& rest) {
  constexpr int kRings = 80;
  std::vector<double> edges;
  for (int i = 0; i <= kRings; ++i) {
    const double from_edge = 1 - static_cast<double>(i) / kRings;
    edges.push_back(1 - from_edge * from_edge);
  }
  const Eigen::MatrixXd rise = detail::rubber_rise(edges, edges, w.rubber_mm / s.radius_mm());
  Eigen::VectorXd suction(kRings);
  for (int j = 0; j < kRings; ++j) {
    // The mean over the ring.
    const double a = edges[static_cast<std::size_t>(j)], b = edges[static_cast<std::size_t>(j) + 1];
    suction[j] = 1 - (a * a + b * b) / 2;
  }
  const double modulus = w.rubber_mpa * 1e6 / 3;
  const Eigen::VectorXd w_m = d.even_suction * d.radius / modulus * (rise * suction);
  rest.middle_um = w_m[0] * 1e6;
  rest.rim_um = w_m[kRings] * 1e6;
  // But at the outline itself, where suction ends in a corner and the slope with it.
  for (int i = 0; i + 1 < kRings; ++i) {
    const double way = edges[static_cast<std::size_t>(i) + 1] - edges[static_cast<std::size_t>(i)];
    rest.slope = std::max(rest.slope, std::abs(w_m[i + 1] - w_m[i]) / (way * d.radius));
  }
  rest.time_s = 12 * s.viscosity_pa_s * std::pow(w.rubber_mm / s.gap_um, 3) * 1e9 / (3 * modulus);
  rest.at_most = true;
}

}  // namespace

double PulledSection::radius_mm() const { return std::sqrt(area_mm2 / std::numbers::pi); }

WindowRest window_rest(const FlowWindow& w, const PulledSection& s) {
  const SiDisc d = disc_of(w, s);
  WindowRest rest;
  const double mobility = std::pow(d.gap, 3) / (12 * s.viscosity_pa_s);
  if (w.springs_um_per_kpa > 0) {
    const double c = w.springs_um_per_kpa * 1e-9;
    rest.middle_um = c * d.suction * 1e6;
    rest.slope = 2 * c * d.suction / d.radius;
    // The first zero of J0, squared.
    rest.time_s = c * d.radius * d.radius / (5.783185962946785 * mobility);
  }
  if (w.film_n_m > 0) {
    const double log_span = std::log(w.film_radius_mm / s.radius_mm());
    const double load = d.even_suction * d.radius * d.radius;
    // A film that stretches: its tension follows from its own rise, -T r w' = the load inside of r. In the
    // mean over the span half of w'² is (load/T)² (11/384 + ln(Rs/R)/16) / Rs², x from 0 to 1 and beyond.
    const double squares =
        std::pow(d.even_suction * d.radius / (w.film_radius_mm * 1e-3) * d.radius, 2) *
        (11.0 / 384 + log_span / 16);
    double tension = w.film_n_m;
    if (w.film_stretch_n_m > 0) {
      // T³ - T0 T² = Y squares has one root above T0; it lies below T0 and the cube root of the right side.
      const double right = w.film_stretch_n_m * squares;
      const auto below = [&](double t) { return t * t * (t - w.film_n_m) < right; };
      tension = halved({tension, tension + std::cbrt(right)}, 200, below).middle();
    }
    rest.middle_um = load / tension * (3.0 / 16 + log_span / 4) * 1e6;
    rest.rim_um = load / (4 * tension) * log_span * 1e6;
    // x/2 - x³/4 is greatest where x² is 2/3.
    rest.slope = d.even_suction * d.radius / tension * std::sqrt(2.0 / 3) / 3;
    const double k = slowest_mode(w.film_radius_mm / s.radius_mm());
    rest.time_s = std::pow(d.radius / k, 4) / (mobility * tension);
  }
  if (w.rubber_mm > 0) rest_on_rubber(w, s, d, rest);
  if (w.arm_n_mm > 0) {
    const double arm_um = s.force_n / w.arm_n_mm * 1e3;
    rest.middle_um += arm_um;
    rest.rim_um += arm_um;
  }
  return rest;
}

WindowPull window_pull(const FlowWindow& w, const PulledSection& s) {
  const SiDisc d = disc_of(w, s);
  const detail::Softness soft = softness_of(w, s, d);
  const detail::Peel at = detail::peel(soft);
  WindowPull pull{at.share * s.force_n, at.share, 1, at.tau * s.gap_um};
  if (!w.gives_way()) return pull;
  // All groups but the stretch go as the speed.
  constexpr double kFactor = 1.1;
  const auto faster = [&](double factor) {
    detail::Softness other = soft;
    other.springs *= factor;
    other.film *= factor;
    other.arm *= factor;
    other.rubber *= factor;
    return std::log(detail::peel(other).share);
  };
  pull.exponent = 1 + (faster(kFactor) - faster(1 / kFactor)) / (2 * std::log(kFactor));
  return pull;
}

std::optional<double> window_snap_mm_h(const FlowWindow& w, const PulledSection& s) {
  if (!(w.springs_um_per_kpa > 0)) return std::nullopt;
  const SiDisc d = disc_of(w, s);
  return s.speed_mm_h / (4 * softness_of(w, s, d).springs);
}

}  // namespace slicecorr
