// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Closed parts of any size for benchmarks: a gyroid sheet and a bumpy sphere.
#pragma once

#include <array>
#include <cmath>
#include <cstdint>
#include <functional>
#include <unordered_map>
#include <vector>

#include "slicecorr/mesh.hpp"

namespace slicecorr::test {

/// Where `solid` is above 0, between corners of a grid with `cells` cells of `step_mm` per axis; it
/// must be 0 or less at the grid's border. Marching tetrahedra: each cell is cut into six
/// tetrahedra about its diagonal, so the surface is closed.
inline TriangleMesh level_set(const std::array<int, 3>& cells, double step_mm,
                              const std::function<double(double, double, double)>& solid) {
  const auto nx = static_cast<std::uint64_t>(cells[0]) + 1;
  const auto ny = static_cast<std::uint64_t>(cells[1]) + 1;
  TriangleMesh mesh;
  std::unordered_map<std::uint64_t, std::uint32_t> on_edge;
  std::vector<double> lower(nx * ny), upper(nx * ny);
  const auto fill = [&](int z, std::vector<double>& values) {
    for (std::uint64_t y = 0; y < ny; ++y) {
      for (std::uint64_t x = 0; x < nx; ++x) {
        values[y * nx + x] =
            solid(static_cast<double>(x) * step_mm, static_cast<double>(y) * step_mm, z * step_mm);
      }
    }
  };
  struct Corner {
    std::uint64_t id;
    double value;
    Point3 at;
  };
  const auto crossing = [&](const Corner& a, const Corner& b) {
    const Corner& p = a.id < b.id ? a : b;
    const Corner& q = a.id < b.id ? b : a;
    // Edges of the tetrahedra go to one of seven neighbours of their lower corner.
    const std::uint64_t way = (q.at[0] > p.at[0] ? 1U : 0U) + (q.at[1] > p.at[1] ? 2U : 0U) +
                              (q.at[2] > p.at[2] ? 4U : 0U);
    const auto [known, added] =
        on_edge.try_emplace(p.id * 8 + way, static_cast<std::uint32_t>(mesh.vertices.size()));
    if (added) {
      const double t = p.value / (p.value - q.value);
      Point3 v;
      for (std::size_t k = 0; k < 3; ++k) v[k] = p.at[k] + t * (q.at[k] - p.at[k]);
      mesh.vertices.push_back(v);
    }
    return known->second;
  };
  // Faces point away from what is solid; `inside` corners first, in the tetrahedron's order.
  const auto march = [&](const std::array<Corner, 4>& t, bool mirrored) {
    std::array<int, 4> order{};
    int inside = 0, outside = 3;
    for (int k = 0; k < 4; ++k) {
      if (t[static_cast<std::size_t>(k)].value > 0) {
        order[static_cast<std::size_t>(inside++)] = k;
      } else {
        order[static_cast<std::size_t>(outside--)] = k;
      }
    }
    if (inside == 0 || inside == 4) return;
    int swaps = 0;
    for (std::size_t i = 0; i < 4; ++i) {
      for (std::size_t j = i + 1; j < 4; ++j) swaps += order[i] > order[j];
    }
    const bool turn = (swaps % 2 == 1) != mirrored;
    const auto at = [&](int i, int j) {
      return crossing(t[static_cast<std::size_t>(order[static_cast<std::size_t>(i)])],
                      t[static_cast<std::size_t>(order[static_cast<std::size_t>(j)])]);
    };
    const auto face = [&](std::uint32_t a, std::uint32_t b, std::uint32_t c) {
      if (turn) std::swap(b, c);
      mesh.triangles.push_back({a, b, c});
    };
    if (inside == 1) {
      face(at(0, 1), at(0, 2), at(0, 3));
    } else if (inside == 3) {
      face(at(0, 3), at(1, 3), at(2, 3));
    } else {
      const std::uint32_t a = at(0, 2), b = at(0, 3), c = at(1, 3), d = at(1, 2);
      face(a, b, c);
      face(a, c, d);
    }
  };
  constexpr int paths[6][2] = {{1, 3}, {3, 2}, {2, 6}, {6, 4}, {4, 5}, {5, 1}};
  fill(0, lower);
  for (int z = 0; z < cells[2]; ++z) {
    fill(z + 1, upper);
    for (int y = 0; y < cells[1]; ++y) {
      for (int x = 0; x < cells[0]; ++x) {
        std::array<Corner, 8> c;
        for (int k = 0; k < 8; ++k) {
          const int cx = x + (k & 1), cy = y + (k >> 1 & 1), cz = z + (k >> 2);
          const auto at = static_cast<std::uint64_t>(cy) * nx + static_cast<std::uint64_t>(cx);
          c[static_cast<std::size_t>(k)] = {static_cast<std::uint64_t>(cz) * nx * ny + at,
                                            (cz == z ? lower : upper)[at],
                                            {cx * step_mm, cy * step_mm, cz * step_mm}};
        }
        for (const auto& [i, j] : paths) {
          march({c[0], c[static_cast<std::size_t>(i)], c[static_cast<std::size_t>(j)], c[7]},
                false);
        }
      }
    }
    lower.swap(upper);
  }
  return mesh;
}

/// A sheet along the gyroid with cells of `cell_mm`, about `cell_mm` / 5 thick, cut to a block.
inline TriangleMesh gyroid(const Point3& size_mm, double cell_mm, double step_mm) {
  std::array<int, 3> cells;
  for (std::size_t k = 0; k < 3; ++k)
    cells[k] = static_cast<int>(std::ceil(size_mm[k] / step_mm)) + 2;
  const double w = 2 * M_PI / cell_mm;
  return level_set(cells, step_mm, [&](double x, double y, double z) {
    const double g = std::sin(w * x) * std::cos(w * y) + std::sin(w * y) * std::cos(w * z) +
                     std::sin(w * z) * std::cos(w * x);
    double inside = (0.9 - std::abs(g)) / w;
    const double at[3] = {x, y, z};
    for (std::size_t k = 0; k < 3; ++k) {
      const double middle = 0.5 * step_mm * cells[k];
      inside = std::min(inside, 0.5 * size_mm[k] - std::abs(at[k] - middle));
    }
    return inside;
  });
}

/// A sphere with bumps, 12 faces^2 triangles.
inline TriangleMesh bumpy_sphere(double diameter_mm, int faces) {
  TriangleMesh mesh;
  std::unordered_map<std::uint64_t, std::uint32_t> known;
  const auto vertex = [&](const std::array<int, 3>& p) {
    std::uint64_t key = 0;
    for (const int k : p) key = key * 4096 + static_cast<std::uint64_t>(k + faces);
    const auto [entry, added] =
        known.try_emplace(key, static_cast<std::uint32_t>(mesh.vertices.size()));
    if (added) {
      // Tangents spread the grid of a cube's side evenly over the sphere.
      double v[3], square = 0;
      for (std::size_t k = 0; k < 3; ++k) {
        v[k] = std::tan(M_PI / 4 * p[k] / faces);
        square += v[k] * v[k];
      }
      const double n = std::sqrt(square);
      const double bump =
          std::sin(20 * v[0] / n) * std::sin(20 * v[1] / n) * std::sin(20 * v[2] / n);
      const double r = 0.5 * diameter_mm * (1 + 0.04 * bump) / n;
      mesh.vertices.push_back({r * v[0], r * v[1], r * v[2]});
    }
    return entry->second;
  };
  for (std::size_t axis = 0; axis < 3; ++axis) {
    for (const int side : {-1, 1}) {
      for (int i = 0; i < faces; ++i) {
        for (int j = 0; j < faces; ++j) {
          const auto corner = [&](int a, int b) {
            std::array<int, 3> p{};
            p[axis] = side * faces;
            p[(axis + 1) % 3] = 2 * (i + a) - faces;
            p[(axis + 2) % 3] = 2 * (j + b) - faces;
            return vertex(p);
          };
          std::array<std::uint32_t, 4> q{corner(0, 0), corner(1, 0), corner(1, 1), corner(0, 1)};
          if (side < 0) std::swap(q[1], q[3]);
          mesh.triangles.push_back({q[0], q[1], q[2]});
          mesh.triangles.push_back({q[0], q[2], q[3]});
        }
      }
    }
  }
  return mesh;
}

}  // namespace slicecorr::test
