// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Vectors of three numbers, and boxes of points.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <span>

#include "slicecorr/mesh.hpp"

namespace slicecorr::detail {

inline Point3 difference(const Point3& a, const Point3& b) {
  return {a[0] - b[0], a[1] - b[1], a[2] - b[2]};
}
inline Point3 sum(const Point3& a, const Point3& b, double times = 1) {
  return {a[0] + times * b[0], a[1] + times * b[1], a[2] + times * b[2]};
}
inline double product(const Point3& a, const Point3& b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}
inline double length(const Point3& a) { return std::sqrt(product(a, a)); }
inline Point3 scaled(const Point3& a, double by) { return {a[0] * by, a[1] * by, a[2] * by}; }
inline Point3 crossed(const Point3& a, const Point3& b) {
  return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}

struct PointBox {
  Point3 low, high;
  PointBox() {
    low.fill(std::numeric_limits<double>::infinity());
    high.fill(-std::numeric_limits<double>::infinity());
  }
  explicit PointBox(std::span<const Point3> points) : PointBox() {
    for (const Point3& p : points) add(p);
  }
  void add(const Point3& p) {
    for (std::size_t k = 0; k < 3; ++k) {
      low[k] = std::min(low[k], p[k]);
      high[k] = std::max(high[k], p[k]);
    }
  }
  double diagonal() const { return length(difference(high, low)); }
};

/// The value that a share of `values` does not exceed; puts them into another order. 0 where there is none.
template <class Values>
double value_at(Values& values, double share) {
  if (values.empty()) return 0;
  const auto rank = std::min(values.size() - 1,
                             static_cast<std::size_t>(share * static_cast<double>(values.size())));
  const auto at = values.begin() + static_cast<std::ptrdiff_t>(rank);
  std::nth_element(values.begin(), at, values.end());
  return static_cast<double>(*at);
}

}  // namespace slicecorr::detail
