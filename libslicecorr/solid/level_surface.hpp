// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// The surface of dose 1 in a band of columns, layer by layer.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <vector>

#include "slicecorr/cure.hpp"
#include "slicecorr/mesh.hpp"

namespace slicecorr::detail {

using Triangle = std::array<std::array<float, 3>, 3>;

/// Takes the doses of two neighbouring node planes at a time and gives the triangles between them.
///
/// A cell has its corners at four columns and two nodes. Bit 0 of a corner is the column to the
/// right, bit 1 the row below, bit 2 the node further from the platform. Six tetrahedra, one for
/// each order of the axes from corner 0 to corner 7, cut all cells the same way, so that faces
/// match; each vertex lies on an edge from a corner to one with more bits, so that all cells
/// around an edge compute the same bits.
class LevelSurface {
 public:
  using Sink = std::function<void(const Triangle&)>;
  using VertexSink = std::function<void(const Point3&)>;

  /// Positions of the columns in mm, `y_mm` falling. `vertex` may be empty; it is called once for
  /// each vertex but those of the platform, whose edge begins in these rows but the last.
  LevelSurface(const CureModel& model, std::vector<double> x_mm, std::vector<double> y_mm,
               Sink triangle, VertexSink vertex);

  /// Layer n between nodes n and n + 1: `phi` shown there, `below` the doses of node n + 1, `above`
  /// those of node n; row by row.
  void layer(int n, const double* phi, const double* below, const double* above);
  /// Layer n of a model that is not plain: doses just above node n + 1, and just below node n;
  /// between them the logarithm of the dose is linear, as it is layer by layer.
  void layer(int n, const double* lower, const double* upper);
  /// The faces in the plane of a node, where the dose jumps from `below` to `above`: a layer
  /// without height, so that the surface stays closed.
  void jump(int node, const double* below, const double* above);
  /// Closes the surface on the platform with the doses of node 0.
  void platform(const double* dose);

 private:
  struct Cell;
  std::array<float, 3> vertex(Cell& cell, int a, int b);
  double crossing(const Cell& cell, int a, int b) const;
  void tetrahedra(Cell& cell);
  enum class Inside { plain, logarithmic, flat };
  void cells(int n, Inside kind, const double* phi, const double* below, const double* above);

  const CureModel& model_;
  std::vector<double> x_, y_;
  Sink triangle_;
  VertexSink vertex_;
  std::vector<std::uint8_t> inside_below_, inside_above_;
};

}  // namespace slicecorr::detail
