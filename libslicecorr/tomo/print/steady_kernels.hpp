// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Shares of pixels in a voxel, in several directions at once: what judging level light runs.
#pragma once

#include <cstddef>

#include "tomo/operators/footprint.hpp"

namespace slicecorr::tomo::detail {

struct SteadyDirection {
  double cosine = 1, sine = 0;
  double turn_px = 0;            ///< pixels a mm of u that a voxel moves meanwhile
  TwoBoxes<double> boxes{1, 1};  ///< a voxel's sides, in pixels
};

/// Where a voxel lies, mm, and the pixels: the first one's middle, and one's size.
struct SteadyVoxel {
  double x = 0, y = 0;
  double first_mm = 0, pixel_mm = 1;
  double lit = 1;  ///< share of a pixel's side that is lit
};

inline constexpr int kSteadyAtOnce = 32;

/// Of at most `kSteadyAtOnce` directions: pixels first[k] to first[k] + taps - 1 have
/// shares[tap * kSteadyAtOnce + k]. No voxel may look more than `taps` pixels wide.
void steady_shares(const SteadyDirection* directions, int count, const SteadyVoxel& voxel, int taps,
                   int* first, double* shares);

/// Of light [column][row], rows `pitch` apart, what a footprint takes: the sum of shares of both. `rows`:
/// shares of so many rows, a multiple of 8; beyond the image they are 0, and the light is some number.
struct FootprintOfLight {
  const float *columns = nullptr, *rows = nullptr;
  int column_count = 0, row_count = 0;
};
double footprint_light(const FootprintOfLight& footprint, const float* light, std::size_t pitch);

}  // namespace slicecorr::tomo::detail
