// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Cuts of meshes as the tests of the slicer find them, and how far slices may be off.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

#include "meshes.hpp"
#include "slicecorr/mesh.hpp"

namespace slicecorr::test {

using Real = long double;

/// Area in pixels.
inline double covered(const Bytes& slice) {
  double sum = 0;
  for (const std::uint8_t v : slice) sum += v;
  return sum / 255;
}

/// A level is wrong by half a level at most, and only in pixels that a contour touches.
inline double rounding_bound(double touched_pixels) { return touched_pixels * 0.5 / 255 + 1e-6; }

/// Most pixels that a convex outline in a box of w x h pixels touches: it crosses each of the at
/// most w + 1 and h + 1 lines of the grid twice, and enters a pixel with every crossing.
inline double convex_touches(double w, double h) { return 2 * (w + 1) + 2 * (h + 1); }

struct Flat {
  Real x, y;
};

/// Corners of the cut of a convex mesh at a height: its edges' meeting points, by angle.
inline std::vector<Flat> convex_cut(const TriangleMesh& mesh, double z) {
  std::vector<Flat> points;
  Flat middle{0, 0};
  for (const auto& t : mesh.triangles) {
    for (std::size_t k = 0; k < 3; ++k) {
      const Point3 &a = mesh.vertices[t[k]], &b = mesh.vertices[t[(k + 1) % 3]];
      if (!(a[2] < z && b[2] >= z)) continue;  // every edge is met once this way round
      const Real s = (Real{z} - a[2]) / (Real{b[2]} - a[2]);
      points.push_back({a[0] + s * (Real{b[0]} - a[0]), a[1] + s * (Real{b[1]} - a[1])});
      middle.x += points.back().x;
      middle.y += points.back().y;
    }
  }
  middle.x /= static_cast<Real>(points.size());
  middle.y /= static_cast<Real>(points.size());
  std::sort(points.begin(), points.end(), [&](const Flat& p, const Flat& q) {
    return std::atan2(p.y - middle.y, p.x - middle.x) < std::atan2(q.y - middle.y, q.x - middle.x);
  });
  return points;
}

inline double polygon_area(const std::vector<Flat>& p) {
  Real twice = 0;
  for (std::size_t i = 0; i < p.size(); ++i) {
    const Flat &a = p[i], &b = p[(i + 1) % p.size()];
    twice += a.x * b.y - a.y * b.x;
  }
  return static_cast<double>(twice / 2);
}

}  // namespace slicecorr::test
