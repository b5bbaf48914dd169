// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/bleaching.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "support/numbers/quadrature.hpp"

namespace slicecorr {

namespace {

/// Of Taylor's series in a step. Where e^(E/Eb) is 0 lies the nearest pole of E(s): pi / alpha0 away or
/// more, where light is shown sqrt(E² + (pi Eb)²) / gain. In steps of 1 / (4 pi) of that what is left
/// out is below (1 / (4 pi))^11.
constexpr int kOrder = 10;
constexpr double kStep = 0.25, kPi = 3.14159265358979324;

}  // namespace

double BleachingLaw::absorbed(double dose) const {
  return bleached_ * dose - (fresh_ - bleached_) * dose_ * std::expm1(-dose / dose_);
}

double BleachingLaw::steady(double gain) const {
  // G is concave and between its tangents at 0 and far away: Newton from the left never passes it.
  double dose = gain / fresh_;
  for (int i = 0; i < 100; ++i) {
    const double slope = bleached_ + (fresh_ - bleached_) * std::exp(-dose / dose_);
    const double step = (gain - absorbed(dose)) / slope;
    dose += step;
    if (!(step > 1e-16 * dose)) break;
  }
  return dose;
}

double BleachingLaw::after(double dose, double length, double gain) const {
  const double per_dose = 1.0 / dose_;
  const double spent = (fresh_ - bleached_) * dose_;
  // Coefficients of E and of v = 1 - e^(-E/Eb), v' = (1 - v) E' / Eb.
  std::array<double, kOrder + 1> e, v;
  double before = dose;
  for (double left = length; left != 0;) {
    const double rate = std::max(fresh_, kPi * gain / std::hypot(dose, kPi * dose_));
    const double h = std::copysign(std::min(std::abs(left), kStep / rate), length);
    left -= h;
    e[0] = dose;
    v[0] = -std::expm1(-dose * per_dose);
    std::array<double, kOrder> rise;  // (j + 1) e[j + 1]
    for (std::size_t k = 0; k < kOrder; ++k) {
      rise[k] = (k == 0 ? gain : 0.0) - bleached_ * e[k] - spent * v[k];
      e[k + 1] = rise[k] / static_cast<double>(k + 1);
      double sum = rise[k];
      for (std::size_t j = 0; j <= k; ++j) sum -= v[k - j] * rise[j];
      v[k + 1] = per_dose * sum / static_cast<double>(k + 1);
    }
    double sum = e[kOrder];
    for (std::size_t k = kOrder; k-- > 0;) sum = sum * h + e[k];
    // A dose that stays where it is, or takes turns with its neighbour, stays for any length left.
    if (sum == dose || sum == before || !std::isfinite(sum)) return sum;
    before = dose;
    dose = sum;
  }
  return dose;
}

double BleachingLaw::length(double high, double low) const {
  // Of dE / G(E), over ln E: there between 1/alpha0 and 1/alpha1.
  return gauss_legendre(std::log(low), std::log(high), [&](double ln_dose) {
    const double dose = std::exp(ln_dose);
    return dose / absorbed(dose);
  });
}

}  // namespace slicecorr
