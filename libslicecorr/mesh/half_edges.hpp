/// The sides of all triangles, grouped by edge: what inspection, turning and closing are made from.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "slicecorr/mesh.hpp"
#include "slicecorr/parallel.hpp"

namespace slicecorr::detail {

/// A side of a triangle between two different vertices. It begins at corner k of triangle t, where
/// `corner` is 3 t + k, and has `high`, the higher one of its two vertices.
struct HalfEdge {
  std::uint32_t high, corner;
};

/// Grouped by their lower vertices, in an order that depends on the mesh alone. The mesh must
/// outlive it. Throws `InputError` when an index is out of range.
class HalfEdges {
 public:
  HalfEdges(const TriangleMesh& mesh, const Job& job);

  const TriangleMesh& mesh() const { return mesh_; }
  /// Two corners at the same place: such triangles are no part of the surface.
  bool degenerate(std::size_t triangle) const { return degenerate_[triangle] != 0; }
  /// Whether a side runs from its lower vertex to its higher one.
  bool rises(std::uint32_t corner) const {
    const auto& t = mesh_.triangles[corner / 3];
    const std::uint32_t k = corner % 3;
    return t[k] < t[k == 2 ? 0 : k + 1];
  }
  /// How many chunks `for_each` makes.
  std::size_t chunks() const;
  /// Calls `each(chunk, low, sides)` once for every edge, with all its sides, also those of
  /// degenerate triangles, in the order of their corners. Edges of a chunk come one after the other
  /// and in order; chunks are worked on at once.
  void for_each(const Job& job,
                const std::function<void(std::size_t chunk, std::uint32_t low,
                                         std::span<const HalfEdge> sides)>& each) const;

 private:
  const TriangleMesh& mesh_;
  std::vector<std::uint8_t> degenerate_;
  std::vector<std::uint32_t> begin_;  ///< per vertex
  std::vector<HalfEdge> sides_;
};

/// An edge that its triangles do not run along equally often both ways: contours break there.
struct OpenEdge {
  std::uint32_t low, high;
  std::int32_t surplus;  ///< triangles that run from low to high, less those that run back
};

/// See `flipped_triangles`.
std::vector<bool> flipped(const HalfEdges& halves, const Job& job);

/// In the order of their vertices; `turned` triangles count as if they ran the other way.
std::vector<OpenEdge> open_edges(const HalfEdges& halves, const std::vector<bool>& turned,
                                 const Job& job);

}  // namespace slicecorr::detail
