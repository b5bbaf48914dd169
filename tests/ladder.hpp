// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// The ladder of dissertation figure 2.2 as a mesh, and a writer of binary STL.
#pragma once

#include <cstdint>
#include <cstring>
#include <fstream>
#include <string>
#include <vector>

#include "slicecorr/mesh.hpp"

namespace slicecorr::test {

inline void add_box(TriangleMesh& mesh, const Point3& low, const Point3& high) {
  const auto base = static_cast<std::uint32_t>(mesh.vertices.size());
  for (int corner = 0; corner < 8; ++corner) {
    mesh.vertices.push_back({corner & 1 ? high[0] : low[0], corner & 2 ? high[1] : low[1],
                             corner & 4 ? high[2] : low[2]});
  }
  // Sides as quads, counter-clockwise from outside; bit 0 is x, bit 1 y, bit 2 z.
  constexpr std::uint32_t quads[6][4] = {{0, 2, 3, 1}, {4, 5, 7, 6}, {0, 1, 5, 4},
                                         {2, 6, 7, 3}, {0, 4, 6, 2}, {1, 3, 7, 5}};
  for (const auto& q : quads) {
    mesh.triangles.push_back({base + q[0], base + q[1], base + q[2]});
    mesh.triangles.push_back({base + q[0], base + q[2], base + q[3]});
  }
}

/// Intensities of black and of full light in figure 2.2, over the critical one.
inline constexpr double kPhiMin = 0.0625, kPhiMax = 6.25;

/// Rails over the full height of 2.5 mm, rungs at slices 11-20 and 31-40 of 50 um.
inline TriangleMesh ladder() {
  TriangleMesh mesh;
  add_box(mesh, {-2, -1, 0}, {-1, 1, 2.5});
  add_box(mesh, {1, -1, 0}, {2, 1, 2.5});
  add_box(mesh, {-1, -1, 0.55}, {1, 1, 1.05});
  add_box(mesh, {-1, -1, 1.55}, {1, 1, 2.05});
  return mesh;
}

inline void write_stl(const std::string& path, const TriangleMesh& mesh) {
  std::vector<char> bytes(84 + 50 * mesh.triangles.size());
  const auto count = static_cast<std::uint32_t>(mesh.triangles.size());
  std::memcpy(bytes.data() + 80, &count, 4);
  char* at = bytes.data() + 84;
  for (const auto& t : mesh.triangles) {
    float f[12] = {};
    for (std::size_t k = 0; k < 9; ++k) {
      f[3 + k] = static_cast<float>(mesh.vertices[t[k / 3]][k % 3]);
    }
    std::memcpy(at, f, sizeof f);
    at += 50;
  }
  std::ofstream(path, std::ios::binary)
      .write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
}

}  // namespace slicecorr::test
