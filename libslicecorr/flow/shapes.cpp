// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Phi of shapes whose answer is known: lap Phi = -12, Phi = 0 on the outline.
#include <cmath>
#include <numbers>

#include "slicecorr/flow_section.hpp"

namespace slicecorr::flow_shapes {
namespace {

using std::numbers::pi;

double square(double v) { return v * v; }

/// Sum over odd m of term(m), until terms fall below rounding.
template <typename Term>
double odd_sum(Term term) {
  double sum = 0;
  for (int m = 1; m < 4001; m += 2) {
    const double t = term(static_cast<double>(m));
    sum += t;
    if (std::abs(t) <= 1e-17 * std::abs(sum)) break;
  }
  return sum;
}

}  // namespace

double disc_phi_um2(double radius_um, double r_um) {
  return 3 * (square(radius_um) - square(r_um));
}
double disc_integral_um4(double radius_um) { return 1.5 * pi * square(square(radius_um)); }

double strip_phi_um2(double half_width_um, double x_um) {
  return 6 * (square(half_width_um) - square(x_um));
}
double strip_integral_um3(double half_width_um) {
  return 8 * half_width_um * square(half_width_um);
}

double ellipse_phi_um2(double a_um, double b_um, double x_um, double y_um) {
  const double a2 = square(a_um), b2 = square(b_um);
  return 6 * a2 * b2 / (a2 + b2) * (1 - square(x_um) / a2 - square(y_um) / b2);
}
double ellipse_integral_um4(double a_um, double b_um) {
  return 3 * pi * a_um * square(a_um) * b_um * square(b_um) / (square(a_um) + square(b_um));
}

double rectangle_max_phi_um2(double w, double l) {
  const double sum = odd_sum([&](double m) {
    const double sign = static_cast<int>(m) % 4 == 1 ? 1 : -1;
    return sign / (m * m * m * std::cosh(m * pi * l / (2 * w)));
  });
  return 12 * square(w) * (0.125 - 4 / (pi * pi * pi) * sum);
}
double rectangle_mean_phi_um2(double w, double l) {
  const double sum =
      odd_sum([&](double m) { return std::tanh(m * pi * l / (2 * w)) / (m * square(m * m)); });
  return 12 * square(w) * (1.0 / 12 - 16 * w / (square(pi * pi) * pi * l) * sum);
}

double ring_phi_um2(double inner_um, double outer_um, double r) {
  const double a = inner_um, b = outer_um;
  return 3 * (square(b) - square(r) - (square(b) - square(a)) * std::log(b / r) / std::log(b / a));
}
double ring_peak_um(double inner_um, double outer_um) {
  const double a = inner_um, b = outer_um;
  return std::sqrt((square(b) - square(a)) / (2 * std::log(b / a)));
}

double platform_changeover_um(double platform_radius_um, double part_radius_um, double gap_um) {
  const double ratio = platform_radius_um / part_radius_um;
  return gap_um * std::cbrt(square(square(ratio)));
}

}  // namespace slicecorr::flow_shapes
