// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file bracket.hpp
/// Where something changes, between two numbers: by halves, and by chords where halves take long.
#pragma once

#include <cmath>

namespace slicecorr {

/// Two numbers with what is looked for between them.
struct Bracket {
  double low = 0, high = 0;
  double middle() const { return 0.5 * (low + high); }
};

/// Halves a bracket `times` times, fewer where no number is left between its ends. `below(x)`: what is
/// looked for lies above x.
template <class Below>
Bracket halved(Bracket b, int times, const Below& below) {
  for (int i = 0; i < times; ++i) {
    const double middle = b.middle();
    if (middle == b.low || middle == b.high) break;
    (below(middle) ? b.low : b.high) = middle;
  }
  return b;
}

/// The same by the mean of logarithms, of a bracket above 0, until its ends are within a factor of
/// `ratio`.
template <class Below>
Bracket halved_by_ratio(Bracket b, int times, double ratio, const Below& below) {
  for (int i = 0; i < times && b.high / b.low > ratio; ++i) {
    const double middle = std::sqrt(b.low * b.high);
    if (middle == b.low || middle == b.high) break;
    (below(middle) ? b.low : b.high) = middle;
  }
  return b;
}

/// False position by Illinois' rule, of a function with values of different signs at the ends of a
/// bracket: the value at an end that stays twice counts half.
struct FalsePosition {
  double low = 0, high = 0, at_low = 0, at_high = 0;
  int side = 0;  ///< the end that was taken last: 1 high, -1 low
  /// Where the chord passes 0.
  double chord() const { return (low * at_high - high * at_low) / (at_high - at_low); }
  /// `x` with its value takes the place of an end.
  void take(double x, double value, bool of_high) {
    (of_high ? high : low) = x;
    (of_high ? at_high : at_low) = value;
    const int now = of_high ? 1 : -1;
    if (side == now) (of_high ? at_low : at_high) *= 0.5;
    side = now;
  }
};

}  // namespace slicecorr
