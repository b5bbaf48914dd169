// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Grids on which tests of bodies lay their voxels.
#pragma once

#include "slicecorr/grid.hpp"

namespace slicecorr::test {

inline constexpr double kPixelUm = 50, kLayerUm = 100;

inline Grid grid_of(int width, int height, int layers) {
  return {width, height, layers, kPixelUm, kPixelUm, kLayerUm};
}

}  // namespace slicecorr::test
