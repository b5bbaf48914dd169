// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Where the surface of a mesh crosses pixel columns, and which height each of their edges has.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "slice/solid_rule.hpp"
#include "slicecorr/grid.hpp"
#include "slicecorr/mesh.hpp"

namespace slicecorr::detail {

/// The first row or column whose centre, i + 1/2, lies beyond `at`, which is not negative. What goes
/// from a to b crosses the centres [first_centre(a), first_centre(b)): pieces that share an end share
/// no centre.
inline int first_centre(double at) {
  const int i = static_cast<int>(at);
  return i + (at - i >= 0.5 ? 1 : 0);
}

/// A mesh on the printer: x and y in pixels of the image, z in layers so that slice n is cut at
/// z = n. No corner lies below the platform, z = -1/2.
struct PlacedMesh {
  std::span<const Point3> corners;
  std::span<const std::array<std::uint32_t, 3>> triangles;
  int layers;
  /// Where volumes are taken away: the tag of each triangle, and what tags do.
  std::span<const SolidRule::Tag> tags = {};
  const SolidRule* rule = nullptr;
};

/// The edge heights of a box of pixels.
struct BandEdges {
  struct Edge {
    std::uint32_t column;  ///< of the box, row by row
    std::uint8_t height;   ///< see edge_height_byte
  };
  std::vector<Edge> edges;         ///< node by node
  std::vector<std::size_t> begin;  ///< per node where its edges begin, and where the last ones end

  std::uint64_t columns = 0;  ///< that meet the mesh
  // Solid between two neighbouring middles of layers that contains neither.
  std::uint64_t thin_columns = 0;
  double thin_slices = 0;      ///< their heights, added up
  double thickest_slices = 0;  ///< the largest of them
  std::uint32_t thickest_column = 0;
  double thickest_from = 0;  ///< the lower end of its solid, slices above the middle of layer 0

  std::span<const Edge> at(int node) const {
    const auto n = static_cast<std::size_t>(node);
    return std::span(edges).subspan(begin[n], begin[n + 1] - begin[n]);
  }
};

/// Sends a vertical line through the centre of each pixel of `box`. It is solid where its winding
/// is not 0, or where the rule says so. Where the middles of two layers differ, the edge between them has the height of the
/// crossing there; of several, the height that keeps the solid length between the two middles.
/// Columns that are left with another winding than they begin with pass through a hole of the mesh
/// and have no heights, nor has what stands on the platform a height there.
/// `candidates`: the triangles that may lie in these rows, each once. The result does not depend on
/// their order, and that of a column not on the box.
BandEdges edges_of_columns(const PlacedMesh& mesh, std::span<const std::uint32_t> candidates,
                           const PixelBox& box);

}  // namespace slicecorr::detail
