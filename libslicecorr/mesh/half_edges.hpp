// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// The sides of all triangles, grouped by edge: what inspection, turning and closing are made from.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "parallel/silent.hpp"
#include "slicecorr/mesh.hpp"

namespace slicecorr::detail {

/// A side of a triangle between two different vertices.
class HalfEdge {
 public:
  HalfEdge() = default;
  HalfEdge(std::uint32_t high, std::uint32_t corner, bool rises)
      : high_(high), corner_(2 * corner + rises) {}
  /// The higher one of its two vertices.
  std::uint32_t high() const { return high_; }
  /// It begins at corner k of triangle t: this is 3 t + k.
  std::uint32_t corner() const { return corner_ / 2; }
  std::uint32_t triangle() const { return corner() / 3; }
  /// Whether it runs from its lower vertex to its higher one.
  bool rises() const { return corner_ & 1; }

 private:
  std::uint32_t high_, corner_;
};

/// Sides by chunks of their lower vertices. The mesh must outlive it. Throws `InputError` when an
/// index is out of range.
class HalfEdges {
 public:
  HalfEdges(const TriangleMesh& mesh, const ExecutionContext& context);

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
  std::size_t chunks() const { return begin_.size() - 1; }
  /// Calls `each(chunk, low, sides)` once for every edge, `sides` being a span of all its sides,
  /// also those of degenerate triangles, in the order of their corners. Edges of a chunk come one
  /// after the other and in order; chunks are worked on at once.
  template <class Each>
  void for_each(const ExecutionContext& context, const Each& each) const {
    parallel_for(silent(context), "", chunks(), [&](std::size_t chunk) {
      const Sorted s = sorted(chunk);
      for (std::size_t v = 0; v + 1 < s.begin.size(); ++v) {
        const auto low = static_cast<std::uint32_t>(chunk * vertices_per_chunk_ + v);
        for (std::uint32_t i = s.begin[v]; i < s.begin[v + 1];) {
          std::uint32_t past = i + 1;
          while (past < s.begin[v + 1] && s.sides[past].high() == s.sides[i].high()) ++past;
          each(chunk, low, std::span<const HalfEdge>(s.sides.get() + i, past - i));
          i = past;
        }
      }
    });
  }

 private:
  struct Side {
    std::uint32_t low;
    HalfEdge half;
  };
  /// The sides of a chunk, by their lower vertices, higher vertices and corners.
  struct Sorted {
    std::vector<std::uint32_t> begin;  ///< per lower vertex
    std::unique_ptr<HalfEdge[]> sides;
  };
  Sorted sorted(std::size_t chunk) const;

  const TriangleMesh& mesh_;
  std::size_t vertices_per_chunk_;
  std::unique_ptr<std::uint8_t[]> degenerate_;
  std::vector<std::size_t> begin_;  ///< per chunk: where its sides begin
  std::unique_ptr<Side[]> sides_;   ///< those of a chunk in the order of their corners
};

/// See `flipped_triangles`.
std::vector<bool> flipped(const HalfEdges& halves, const ExecutionContext& context);

/// In the order of their vertices; `turned` triangles count as if they ran the other way. None are
/// turned when it is empty.
std::vector<EdgeDefects::OpenEdge> open_edges(const HalfEdges& halves,
                                              const std::vector<bool>& turned,
                                              const ExecutionContext& context);

/// What `inspect` finds of them, alone.
EdgeDefects edge_defects_of(const TriangleMesh& mesh, const ExecutionContext& context);

/// Where the marks are true, rising.
inline std::vector<std::uint32_t> indices_of(const std::vector<bool>& marks) {
  std::vector<std::uint32_t> indices;
  for (std::size_t i = 0; i < marks.size(); ++i) {
    if (marks[i]) indices.push_back(static_cast<std::uint32_t>(i));
  }
  return indices;
}

/// Joins what chunks found, in their order.
template <class Value>
std::vector<Value> joined(const std::vector<std::vector<Value>>& chunks) {
  std::vector<Value> all;
  for (const auto& values : chunks) all.insert(all.end(), values.begin(), values.end());
  return all;
}

}  // namespace slicecorr::detail
