// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file grid.hpp
/// The voxel grid that targets, stacks, corrections and predictions share.
///
/// Frame: z is measured from the build platform towards the window and grows downwards in the part.
/// Plane k * layer_um is node k; layer n lies between nodes n and n + 1 and is shown by slice n.
/// Image row 0 is at the largest y, column 0 at the smallest x.
///
/// Plain values; nothing here throws, and const functions are thread-safe.
#pragma once

#include <algorithm>
#include <cstdint>

namespace slicecorr {

/// Size and scale of a stack of slices.
struct Grid {
  int width_px = 0;       ///< columns of an image, 1..65536
  int height_px = 0;      ///< rows of an image, 1..65536
  int layers = 0;         ///< number of slices, 1..1000000
  double pixel_x_um = 0;  ///< width of a pixel on the window; 0: not known
  double pixel_y_um = 0;  ///< height of a pixel on the window; 0: not known
  double layer_um = 0;    ///< slice height hs; 0: not known
};

/// Half-open box of pixels [x0, x1) x [y0, y1).
struct PixelBox {
  int x0 = 0, y0 = 0, x1 = 0, y1 = 0;
  bool empty() const { return x0 >= x1 || y0 >= y1; }
  int width() const { return std::max(0, x1 - x0); }
  int height() const { return std::max(0, y1 - y0); }
  /// The smallest box that holds both; an empty box adds nothing.
  PixelBox united(const PixelBox& o) const {
    if (empty()) return o;
    if (o.empty()) return *this;
    return {std::min(x0, o.x0), std::min(y0, o.y0), std::max(x1, o.x1), std::max(y1, o.y1)};
  }
};

}  // namespace slicecorr
