// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "view/envelope.hpp"

#include <algorithm>
#include <array>
#include <cmath>

namespace slicecorr::bridge::detail {
namespace {

using chart::Point;

bool finite(const Point& p) { return std::isfinite(p.x) && std::isfinite(p.y); }

/// Which of `columns` equal pieces between two values.
class Pieces {
 public:
  Pieces(double low, double high, int columns)
      : low_(low), scale_(high > low ? columns / (high - low) : 0), last_(columns - 1) {}
  int of(double x) const { return std::clamp(static_cast<int>((x - low_) * scale_), 0, last_); }

 private:
  double low_, scale_;
  int last_;
};

}  // namespace

std::vector<Point> envelope(std::vector<Point> points, int columns) {
  std::erase_if(points, [](const Point& p) { return !finite(p); });
  std::stable_sort(points.begin(), points.end(),
                   [](const Point& a, const Point& b) { return a.x < b.x; });
  if (points.size() <= 4 * static_cast<std::size_t>(columns)) return points;
  const Pieces pieces(points.front().x, points.back().x, columns);
  std::vector<Point> thin;
  for (std::size_t i = 0; i < points.size();) {
    const int piece = pieces.of(points[i].x);
    std::size_t end = i, least = i, greatest = i;
    for (; end < points.size() && pieces.of(points[end].x) == piece; ++end) {
      if (points[end].y < points[least].y) least = end;
      if (points[end].y > points[greatest].y) greatest = end;
    }
    std::array<std::size_t, 4> kept{i, least, greatest, end - 1};
    std::sort(kept.begin(), kept.end());
    for (std::size_t k = 0; k < kept.size(); ++k) {
      if (k == 0 || kept[k] != kept[k - 1]) thin.push_back(points[kept[k]]);
    }
    i = end;
  }
  return thin;
}

std::vector<Peak> peaks(const std::vector<Point>& points, int columns) {
  std::vector<Peak> all(static_cast<std::size_t>(columns));
  double low = INFINITY, high = -INFINITY;
  for (const Point& p : points) {
    if (!finite(p)) continue;
    low = std::min(low, p.x);
    high = std::max(high, p.x);
  }
  const Pieces pieces(low, high, columns);
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (!finite(points[i])) continue;
    Peak& peak = all[static_cast<std::size_t>(pieces.of(points[i].x))];
    if (peak.count++ == 0 || std::abs(points[i].y) > std::abs(peak.at.y)) {
      peak.at = points[i];
      peak.index = i;
    }
  }
  std::erase_if(all, [](const Peak& p) { return p.count == 0; });
  return all;
}

}  // namespace slicecorr::bridge::detail
