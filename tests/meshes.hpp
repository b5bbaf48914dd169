// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Meshes of known shape, and how the tests of the slicer slice them.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <map>
#include <numbers>
#include <random>
#include <vector>

#include "slicecorr/mesh.hpp"
#include "slicecorr/slice.hpp"

namespace slicecorr::test {

using Bytes = std::vector<std::uint8_t>;

inline TriangleMesh box(const Point3& low, const Point3& high) {
  TriangleMesh mesh;
  for (int k = 0; k < 8; ++k) {
    mesh.vertices.push_back(
        {k & 1 ? high[0] : low[0], k & 2 ? high[1] : low[1], k & 4 ? high[2] : low[2]});
  }
  mesh.triangles = {{0, 2, 1}, {1, 2, 3},   // below
                    {4, 5, 6}, {5, 7, 6},   // above
                    {0, 1, 4}, {1, 5, 4},   // y low
                    {2, 6, 3}, {3, 6, 7},   // y high
                    {0, 4, 2}, {2, 4, 6},   // x low
                    {1, 3, 5}, {3, 7, 5}};  // x high
  return mesh;
}

inline TriangleMesh inverted(TriangleMesh mesh) {
  for (auto& t : mesh.triangles) std::swap(t[1], t[2]);
  return mesh;
}

inline TriangleMesh operator+(TriangleMesh a, const TriangleMesh& b) {
  append(a, b);
  return a;
}

/// Turned about the axes through the origin, in radians.
inline TriangleMesh turned(TriangleMesh mesh, double about_x, double about_z) {
  for (Point3& v : mesh.vertices) {
    const double y = v[1] * std::cos(about_x) - v[2] * std::sin(about_x);
    v[2] = v[1] * std::sin(about_x) + v[2] * std::cos(about_x);
    v[1] = v[0] * std::sin(about_z) + y * std::cos(about_z);
    v[0] = v[0] * std::cos(about_z) - y * std::sin(about_z);
  }
  return mesh;
}

inline TriangleMesh sphere(double radius, int halvings) {
  const double g = (1 + std::sqrt(5.0)) / 2;
  TriangleMesh mesh;
  mesh.vertices = {{-1, g, 0},  {1, g, 0},  {-1, -g, 0}, {1, -g, 0}, {0, -1, g},  {0, 1, g},
                   {0, -1, -g}, {0, 1, -g}, {g, 0, -1},  {g, 0, 1},  {-g, 0, -1}, {-g, 0, 1}};
  mesh.triangles = {{0, 11, 5}, {0, 5, 1},  {0, 1, 7},   {0, 7, 10}, {0, 10, 11},
                    {1, 5, 9},  {5, 11, 4}, {11, 10, 2}, {10, 7, 6}, {7, 1, 8},
                    {3, 9, 4},  {3, 4, 2},  {3, 2, 6},   {3, 6, 8},  {3, 8, 9},
                    {4, 9, 5},  {2, 4, 11}, {6, 2, 10},  {8, 6, 7},  {9, 8, 1}};
  const auto onto = [radius](Point3 v) {
    const double length = std::hypot(v[0], v[1], v[2]);
    for (double& c : v) c *= radius / length;
    return v;
  };
  for (Point3& v : mesh.vertices) v = onto(v);
  for (int i = 0; i < halvings; ++i) {
    std::map<std::pair<std::uint32_t, std::uint32_t>, std::uint32_t> middles;
    const auto middle = [&](std::uint32_t a, std::uint32_t b) {
      const auto [it, fresh] =
          middles.try_emplace(std::minmax(a, b), static_cast<std::uint32_t>(mesh.vertices.size()));
      if (fresh) {
        const Point3 &p = mesh.vertices[a], &q = mesh.vertices[b];
        mesh.vertices.push_back(onto({p[0] + q[0], p[1] + q[1], p[2] + q[2]}));
      }
      return it->second;
    };
    std::vector<std::array<std::uint32_t, 3>> finer;
    for (const auto& [a, b, c] : mesh.triangles) {
      const std::uint32_t ab = middle(a, b), bc = middle(b, c), ca = middle(c, a);
      finer.insert(finer.end(), {{a, ab, ca}, {b, bc, ab}, {c, ca, bc}, {ab, bc, ca}});
    }
    mesh.triangles = std::move(finer);
  }
  return mesh;
}

/// A pyramid over a regular polygon.
inline TriangleMesh cone(double radius, double height, int corners) {
  TriangleMesh mesh;
  for (int i = 0; i < corners; ++i) {
    const double a = 2 * std::numbers::pi * i / corners;
    mesh.vertices.push_back({radius * std::cos(a), radius * std::sin(a), 0});
  }
  mesh.vertices.push_back({0, 0, height});
  mesh.vertices.push_back({0, 0, 0});
  const auto n = static_cast<std::uint32_t>(corners);
  for (std::uint32_t i = 0; i < n; ++i) {
    mesh.triangles.push_back({i, (i + 1) % n, n});
    mesh.triangles.push_back({(i + 1) % n, i, n + 1});
  }
  return mesh;
}

/// Bodies that overlap, and triangles that belong to none.
inline TriangleMesh messy() {
  std::mt19937_64 random(5);
  std::uniform_real_distribution<double> at(0, 3);
  TriangleMesh mesh = sphere(1.2, 2) + turned(box({0, 0, 0}, {1, 2, 1.5}), 0.4, 0.7);
  for (int i = 0; i < 60; ++i) {
    const auto n = static_cast<std::uint32_t>(mesh.vertices.size());
    for (int k = 0; k < 3; ++k) mesh.vertices.push_back({at(random), at(random), at(random)});
    mesh.triangles.push_back({n, n + 1, n + 2});
  }
  return mesh;
}

inline Printer printer(int width, int height, double pixel_x_um, double pixel_y_um) {
  Printer p;
  p.name = "tester";
  p.width_px = width;
  p.height_px = height;
  p.pixel_x_um = pixel_x_um;
  p.pixel_y_um = pixel_y_um;
  p.calibration = {{0, 0}, {255, 10}};
  return p;
}

inline SliceOptions layer_of(double um, bool antialias = true) {
  SliceOptions o;
  o.layer_um = um;
  o.antialias = antialias;
  o.edge_heights = true;
  return o;
}

/// All slices of a box of pixels; a slice that is black there is all 0.
inline std::vector<Bytes> read(const SliceSource& source, const PixelBox& b) {
  std::vector<Bytes> slices;
  source.read_band(b, [&](int slice, const std::uint8_t* rows) {
    EXPECT_EQ(slice, static_cast<int>(slices.size()));
    const auto size = static_cast<std::size_t>(b.width()) * static_cast<std::size_t>(b.height());
    slices.push_back(rows ? Bytes(rows, rows + size) : Bytes(size, 0));
  });
  EXPECT_EQ(static_cast<int>(slices.size()), source.grid().layers);
  return slices;
}
inline std::vector<Bytes> read(const SliceSource& source) {
  return read(source, {0, 0, source.grid().width_px, source.grid().height_px});
}

}  // namespace slicecorr::test
