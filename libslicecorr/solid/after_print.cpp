// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "solid/after_print.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <utility>

namespace slicecorr::detail {

namespace {

/// A corner of a triangle, by its place: triangles that meet share the bits of it.
struct CornerAt {
  std::array<float, 3> place;
  std::size_t triangle;
  std::size_t corner;
};

/// The level part of a triangle's normal, times its area, and how steep it is: 0 level, 1 upright.
struct Level {
  double x, y, steep;
};
Level level_of(const Triangle& t) {
  double a[3], b[3];
  for (std::size_t k = 0; k < 3; ++k) {
    a[k] = static_cast<double>(t[1][k]) - static_cast<double>(t[0][k]);
    b[k] = static_cast<double>(t[2][k]) - static_cast<double>(t[0][k]);
  }
  const double x = a[1] * b[2] - a[2] * b[1], y = a[2] * b[0] - a[0] * b[2],
               z = a[0] * b[1] - a[1] * b[0];
  const double all = std::hypot(x, y, z);
  return {x, y, all > 0 ? std::hypot(x, y) / all : 0};
}

/// Below this steepness, a face moves less than walls do: what is level stays.
constexpr double kWallSteep = 0.5;
/// The least part of a move that goes along the normal of one of the walls that meet: corners sharper than that move less.
constexpr double kLeastAlong = 0.5;

}  // namespace

bool AfterPrint::is_low(const Triangle& t) const {
  return grows() && std::any_of(t.begin(), t.end(), [&](const auto& corner) {
           return is_low(static_cast<double>(corner[2]));
         });
}

Point3 AfterPrint::shrunk(const Point3& p) const {
  Point3 out{};
  for (std::size_t k = 0; k < 3; ++k) {
    out[k] = middle_[k] + (p[k] - middle_[k]) * shrinkage_.left(k);
  }
  return out;
}

void AfterPrint::shrink(Triangle& t) const {
  if (!shrinkage_.shrinks()) return;
  for (auto& corner : t) {
    const Point3 p = shrunk({static_cast<double>(corner[0]), static_cast<double>(corner[1]),
                             static_cast<double>(corner[2])});
    for (std::size_t k = 0; k < 3; ++k) corner[k] = static_cast<float>(p[k]);
  }
}

void AfterPrint::grow(std::vector<Triangle>& low,
                      const std::function<void(const Point3&)>& vertex) const {
  std::vector<CornerAt> corners;
  std::vector<Level> levels;
  levels.reserve(low.size());
  for (std::size_t i = 0; i < low.size(); ++i) {
    levels.push_back(level_of(low[i]));
    for (std::size_t k = 0; k < 3; ++k) {
      if (is_low(static_cast<double>(low[i][k][2]))) corners.push_back({low[i][k], i, k});
    }
  }
  // All triangles around a corner that is low are here. In an order that no thread changes.
  std::sort(corners.begin(), corners.end(), [](const CornerAt& one, const CornerAt& other) {
    if (one.place != other.place) return one.place < other.place;
    return std::pair(one.triangle, one.corner) < std::pair(other.triangle, other.corner);
  });
  for (std::size_t from = 0, to = 0; from < corners.size(); from = to) {
    double x = 0, y = 0, steep = 0;
    for (to = from; to < corners.size() && corners[to].place == corners[from].place; ++to) {
      const Level& l = levels[corners[to].triangle];
      x += l.x;
      y += l.y;
      steep = std::max(steep, l.steep);
    }
    const double size = std::hypot(x, y);
    Point3 p{static_cast<double>(corners[from].place[0]),
             static_cast<double>(corners[from].place[1]),
             static_cast<double>(corners[from].place[2])};
    if (size > 0) {
      x /= size;
      y /= size;
      // As far that each of the walls that meet moves by as much.
      double along = 1;
      for (std::size_t i = from; i < to; ++i) {
        const Level& l = levels[corners[i].triangle];
        const double its = std::hypot(l.x, l.y);
        if (l.steep > kWallSteep && its > 0) along = std::min(along, (x * l.x + y * l.y) / its);
      }
      const double mm = 1e-3 * shrinkage_.growth_at_um(p[2] * 1e3) *
                        std::min(1.0, steep / kWallSteep) / std::max(kLeastAlong, along);
      p[0] += mm * x;
      p[1] += mm * y;
    }
    for (std::size_t i = from; i < to; ++i) {
      auto& corner = low[corners[i].triangle][corners[i].corner];
      corner[0] = static_cast<float>(p[0]);
      corner[1] = static_cast<float>(p[1]);
    }
    if (vertex && p[2] > 0) vertex(p);
  }
}

}  // namespace slicecorr::detail
