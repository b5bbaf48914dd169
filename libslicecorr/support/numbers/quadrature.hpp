// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Integrals of smooth functions.
#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <limits>

namespace slicecorr {

/// The integral of `f` from `from` to `to`, negative where that is less, by Gauss's rule of five places
/// on pieces of at most `piece`; NaN where an end is not finite.
template <typename Function>
double gauss_legendre(double from, double to, Function f, double piece = 0.5) {
  constexpr std::array<double, 3> place{0.0, 0.53846931010568309, 0.90617984593866399};
  constexpr std::array<double, 3> weight{0.56888888888888889, 0.47862867049936647,
                                         0.23692688505618909};
  if (!std::isfinite(to - from)) return std::numeric_limits<double>::quiet_NaN();
  const double pieces = std::ceil(std::abs(to - from) / piece);
  const double half = 0.5 * (to - from) / pieces;
  double sum = 0;
  for (double k = 0; k < pieces; ++k) {
    const double middle = from + (2 * k + 1) * half;
    sum += weight[0] * f(middle);
    for (std::size_t i = 1; i < place.size(); ++i) {
      sum += weight[i] * (f(middle + place[i] * half) + f(middle - place[i] * half));
    }
  }
  return pieces > 0 ? sum * half : 0.0;
}

}  // namespace slicecorr
