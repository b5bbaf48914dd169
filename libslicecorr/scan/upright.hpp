// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What lies between a place of a surface and the platform.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "slicecorr/mesh.hpp"

namespace slicecorr::detail {

/// Triangles by the squares of the plate that they cover.
class UprightLines {
 public:
  /// The mesh must stay.
  explicit UprightLines(const TriangleMesh& mesh);
  /// The greatest z below `from` at which the line towards the platform meets the surface; nothing where it meets none.
  std::optional<double> below(const Point3& from) const;

 private:
  int column(double v, std::size_t axis) const;
  const TriangleMesh& mesh_;
  Point3 low_{};
  double side_ = 1;
  int across_ = 1, along_ = 1;
  std::vector<std::uint32_t> begin_, list_;
};

}  // namespace slicecorr::detail
