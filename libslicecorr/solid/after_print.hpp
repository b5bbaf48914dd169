// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What becomes of a printed surface: its first layers stand out, and it shrinks (shrinkage.hpp).
#pragma once

#include <functional>
#include <vector>

#include "slicecorr/mesh.hpp"
#include "slicecorr/shrinkage.hpp"
#include "solid/level_surface.hpp"

namespace slicecorr::detail {

class AfterPrint {
 public:
  /// It shrinks about the middle of what is shown, and towards the platform.
  AfterPrint(const Shrinkage& shrinkage, double middle_x_mm, double middle_y_mm)
      : shrinkage_(shrinkage), middle_{middle_x_mm, middle_y_mm, 0} {}
  bool grows() const { return shrinkage_.grows(); }
  /// Whether a corner of it moves when the first layers grow.
  bool is_low(const Triangle& t) const;
  bool is_low(double z_mm) const { return grows() && z_mm * 1e3 < shrinkage_.height_um; }
  void shrink(Triangle& t) const;
  Point3 shrunk(const Point3& p) const;
  /// Moves the corners of all triangles that are low. `vertex`, unless empty, is called once for each corner that moves but
  /// those on the platform, with its place before it shrinks.
  void grow(std::vector<Triangle>& low, const std::function<void(const Point3&)>& vertex) const;

 private:
  Shrinkage shrinkage_;
  Point3 middle_;
};

}  // namespace slicecorr::detail
