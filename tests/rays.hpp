// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Vertical lines through meshes: the tests' own way to know where a mesh is solid.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "slicecorr/mesh.hpp"

namespace slicecorr::test {

using Real = long double;

/// Where the vertical line at x, y (mm) crosses the mesh: heights in mm with directions, or nothing
/// when it passes so near to an edge of a triangle that either side is right.
inline std::optional<std::vector<std::pair<Real, int>>> crossings(
    const TriangleMesh& mesh, std::span<const std::uint32_t> triangles, Real x, Real y) {
  std::vector<std::pair<Real, int>> found;
  for (const std::uint32_t i : triangles) {
    const Point3* p[3];
    for (std::size_t k = 0; k < 3; ++k) p[k] = &mesh.vertices[mesh.triangles[i][k]];
    Real area[3];
    for (std::size_t k = 0; k < 3; ++k) {
      const Point3 &a = *p[(k + 1) % 3], &b = *p[(k + 2) % 3];
      area[k] = (a[0] - x) * (b[1] - y) - (a[1] - y) * (b[0] - x);
    }
    const Real sum = area[0] + area[1] + area[2];
    const bool inside =
        (area[0] > 0 && area[1] > 0 && area[2] > 0) || (area[0] < 0 && area[1] < 0 && area[2] < 0);
    const Real least = std::min({std::abs(area[0]), std::abs(area[1]), std::abs(area[2])});
    if (least < 1e-12L) {
      const auto [x0, x1] = std::minmax({(*p[0])[0], (*p[1])[0], (*p[2])[0]});
      const auto [y0, y1] = std::minmax({(*p[0])[1], (*p[1])[1], (*p[2])[1]});
      if (x >= x0 - 1e-9L && x <= x1 + 1e-9L && y >= y0 - 1e-9L && y <= y1 + 1e-9L) return {};
    }
    if (!inside) continue;
    const Real z = (area[0] * (*p[0])[2] + area[1] * (*p[1])[2] + area[2] * (*p[2])[2]) / sum;
    found.emplace_back(z, sum > 0 ? -1 : 1);
  }
  std::sort(found.begin(), found.end());
  return found;
}

/// Length of what is solid in [low, high], heights in slices.
inline Real solid_in(const std::vector<std::pair<Real, int>>& crossings, Real low, Real high) {
  Real sum = 0, from = 0;
  int winding = 0;
  for (const auto& [z, direction] : crossings) {
    if (winding != 0) sum += std::max<Real>(0, std::min(z, high) - std::max(from, low));
    from = z;
    winding += direction;
  }
  return sum;
}

inline bool solid_at(const std::vector<std::pair<Real, int>>& crossings, Real z) {
  int winding = 0;
  for (const auto& [at, direction] : crossings) winding += at < z ? direction : 0;
  return winding != 0;
}

}  // namespace slicecorr::test
