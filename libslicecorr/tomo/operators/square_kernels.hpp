// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Rows of voxels and the pixels that light them: what `make_square_projector` runs.
#pragma once

#include <cstdint>
#include <vector>

namespace slicecorr::tomo::detail {

/// The voxels of a row that hold resin, seen in one direction. Lengths are in pixels.
struct SquareRow {
  int count = 0;
  double place = 0;            ///< of the first voxel among the pixels
  float step = 0;              ///< to the next one
  float one = 0, other = 0;    ///< widths of a voxel's sides
  float u = 0, u_step = 0;     ///< of the voxels, times how far the vial turns
  int taps = 0;                ///< pixels that a voxel may meet
  const float* dim = nullptr;  ///< e^(-alpha u), or null
  float dim_row = 1;
  float lit = 1;  ///< share of a pixel's width that is lit, in its middle
};

/// Weights of the pixels `first[k]` to `first[k] + taps - 1` on voxel k: [tap][count].
void weigh_row(const SquareRow& row, int* first, float* weights);

/// Slices of a block that light reaches: bits; null where all of them are lit.
using Masks = const std::uint32_t*;

/// Adds to voxels [count][lanes] what pixels give; `light` is pixel 0's, [pixel][lanes], with room on
/// both sides for whatever `first` says.
void gather_row(const SquareRow& row, int lanes, const int* first, const float* weights, Masks lit,
                const float* light, float* field);
/// The same the other way.
void scatter_row(const SquareRow& row, int lanes, const int* first, const float* weights, Masks lit,
                 const float* field, float* light);

}  // namespace slicecorr::tomo::detail
