// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <algorithm>

#include "slicecorr/target.hpp"

namespace slicecorr {

int band_rows(const Grid& grid) {
  // A band through all slices should hold about 64 million voxels; fewer rows than 8 would make
  // pieces too short to compress, more than 32 would leave too few bands for the threads.
  const double voxels_per_row = static_cast<double>(grid.width_px) * grid.layers;
  return static_cast<int>(std::clamp(64e6 / std::max(voxels_per_row, 1.0), 8.0, 32.0));
}

bool SliceSource::ends_below_last_node() const {
  const SliceSource* const heights = edge_heights();
  if (!heights) return false;
  const PixelBox box = heights->bounds();
  const int last = grid().layers, rows = band_rows(grid());
  for (int y = box.y0; y < box.y1; y += rows) {
    const PixelBox band{box.x0, y, box.x1, std::min(y + rows, box.y1)};
    bool found = false;
    heights->read_slices(band, last, last + 1, [&](int, const std::uint8_t* bytes) {
      const auto size = static_cast<std::ptrdiff_t>(band.width()) * band.height();
      found =
          bytes && std::any_of(bytes, bytes + size, [](std::uint8_t b) { return b > kEdgeAtNode; });
    });
    if (found) return true;
  }
  return false;
}

}  // namespace slicecorr
