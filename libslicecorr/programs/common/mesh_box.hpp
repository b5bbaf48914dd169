// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// The box around meshes.
#pragma once

#include <cstddef>
#include <limits>

#include "slicecorr/mesh.hpp"

namespace slicecorr::cli {

struct Box {
  Point3 low, high;
  Box() {
    low.fill(std::numeric_limits<double>::infinity());
    high.fill(-std::numeric_limits<double>::infinity());
  }
  void add(const TriangleMesh& mesh) { widen_box(mesh, low, high); }
  double middle(std::size_t k) const { return 0.5 * (low[k] + high[k]); }
};

}  // namespace slicecorr::cli
