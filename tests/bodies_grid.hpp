// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Grids on which tests of bodies lay their voxels.
#pragma once

#include <array>
#include <cstdint>

#include "memory_slices.hpp"
#include "slicecorr/grid.hpp"

namespace slicecorr::test {

inline constexpr double kPixelUm = 50, kLayerUm = 100;

inline Grid grid_of(int width, int height, int layers) {
  return {width, height, layers, kPixelUm, kPixelUm, kLayerUm};
}

inline void fill(MemorySlices& slices, std::array<int, 3> low, std::array<int, 3> high,
                 std::uint8_t value = 255) {
  for (int n = low[2]; n < high[2]; ++n) {
    for (int y = low[1]; y < high[1]; ++y) {
      for (int x = low[0]; x < high[0]; ++x) slices.at(n, x, y) = value;
    }
  }
}

}  // namespace slicecorr::test
