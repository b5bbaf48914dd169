/// Splitting a box of pixels into bands.
#pragma once

#include <vector>

#include "slicecorr/target.hpp"

namespace slicecorr::detail {

/// The bands that cover `box`, from the top row down, aligned to band_rows(grid).
inline std::vector<PixelBox> bands_of(const Grid& grid, const PixelBox& box) {
  std::vector<PixelBox> bands;
  if (box.empty()) return bands;
  const int rows = band_rows(grid);
  for (int y = box.y0 / rows * rows; y < box.y1; y += rows) {
    bands.push_back({box.x0, y, box.x1, std::min(y + rows, grid.height_px)});
  }
  return bands;
}

inline std::size_t columns_of(const PixelBox& box) {
  return static_cast<std::size_t>(box.width()) * static_cast<std::size_t>(box.height());
}

}  // namespace slicecorr::detail
