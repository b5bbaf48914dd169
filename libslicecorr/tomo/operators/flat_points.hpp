// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Sums and products of places across the axis.
#pragma once

#include <cmath>

#include "slicecorr/process.hpp"

namespace slicecorr::tomo::detail {

inline double dot(const FlatPoint& a, const FlatPoint& b) {
  return a.x_mm * b.x_mm + a.y_mm * b.y_mm;
}
inline FlatPoint plus(const FlatPoint& a, const FlatPoint& b, double times) {
  return {a.x_mm + times * b.x_mm, a.y_mm + times * b.y_mm};
}
inline FlatPoint to_length_1(const FlatPoint& a) {
  const double l = std::hypot(a.x_mm, a.y_mm);
  return {a.x_mm / l, a.y_mm / l};
}

}  // namespace slicecorr::tomo::detail
