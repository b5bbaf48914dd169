// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file surface_maps.hpp
/// How far the surface of a print is from its design, as seen from below and from above.
///
/// Plain values.
#pragma once

#include <vector>

#include "slicecorr/grid.hpp"

namespace slicecorr {

/// A cell is a square of pixels. *From below*, a column shows its edge nearest to the platform,
/// unless its feature lies on the platform; *from above*, the edge farthest from it. A cell has the
/// mean over its columns of how far the print reaches beyond the edge (less than 0: of how much is
/// missing there), um: from the mesh where the target knows its height, else from the edge's node.
/// Columns without such an edge do not count; NaN in cells without any.
struct SurfaceMaps {
  PixelBox box;               ///< of the image; the first cell begins at its upper left corner
  int pixels_per_cell = 1;    ///< >= 1, along x and along y
  int width = 0, height = 0;  ///< cells
  std::vector<float> below_um, above_um;  ///< row by row
  /// At most so many cells along each side.
  static constexpr int kMostCells = 512;
};

}  // namespace slicecorr
