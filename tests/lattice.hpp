// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// A body-centred lattice of round struts: a part with many undercuts, any size, made by code.
#pragma once

#include <cmath>
#include <cstdint>

#include "slicecorr/mesh.hpp"

namespace slicecorr::test {

/// Adds a closed prism of `sides` sides from a to b.
inline void add_strut(TriangleMesh& mesh, const Point3& a, const Point3& b, double radius_mm,
                      int sides) {
  const Point3 d{b[0] - a[0], b[1] - a[1], b[2] - a[2]};
  const double length = std::sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]);
  const Point3 w{d[0] / length, d[1] / length, d[2] / length};
  // Two directions across; the axes of struts are never along x here.
  const Point3 u0{0, w[2], -w[1]};
  const double n = std::sqrt(u0[1] * u0[1] + u0[2] * u0[2]);
  const Point3 u{0, u0[1] / n, u0[2] / n};
  const Point3 v{w[1] * u[2] - w[2] * u[1], w[2] * u[0] - w[0] * u[2], w[0] * u[1] - w[1] * u[0]};
  const auto base = static_cast<std::uint32_t>(mesh.vertices.size());
  const auto count = static_cast<std::uint32_t>(sides);
  for (const Point3& end : {a, b}) {
    for (int i = 0; i < sides; ++i) {
      const double angle = 2 * M_PI * i / sides;
      Point3 p;
      for (std::size_t k = 0; k < 3; ++k) {
        p[k] = end[k] + radius_mm * (std::cos(angle) * u[k] + std::sin(angle) * v[k]);
      }
      mesh.vertices.push_back(p);
    }
  }
  for (std::uint32_t i = 0; i < count; ++i) {
    const std::uint32_t j = (i + 1) % count;
    mesh.triangles.push_back({base + i, base + j, base + count + j});
    mesh.triangles.push_back({base + i, base + count + j, base + count + i});
    if (i + 2 < count) {
      mesh.triangles.push_back({base, base + i + 2, base + i + 1});
      mesh.triangles.push_back({base + count, base + count + i + 1, base + count + i + 2});
    }
  }
}

/// Struts from the corners of cubic cells to their centres.
inline TriangleMesh lattice(int cells_x, int cells_y, int cells_z, double cell_mm, double radius_mm,
                            int sides = 8) {
  TriangleMesh mesh;
  for (int z = 0; z < cells_z; ++z) {
    for (int y = 0; y < cells_y; ++y) {
      for (int x = 0; x < cells_x; ++x) {
        const Point3 middle{(x + 0.5) * cell_mm, (y + 0.5) * cell_mm, (z + 0.5) * cell_mm};
        for (int corner = 0; corner < 8; ++corner) {
          const Point3 c{(x + (corner & 1)) * cell_mm, (y + (corner >> 1 & 1)) * cell_mm,
                         (z + (corner >> 2 & 1)) * cell_mm};
          add_strut(mesh, middle, c, radius_mm, sides);
        }
      }
    }
  }
  return mesh;
}

}  // namespace slicecorr::test
