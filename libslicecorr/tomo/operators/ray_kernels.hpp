// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Rays through all slices, from plane to plane of voxels: what `make_ray_projector` runs.
///
/// A ray that runs more along y than along x is taken where it crosses the rows of voxels, else where
/// it crosses their columns (Joseph 1982): there it lies between two voxels of the row and between two
/// slices, with weights max(0, 1 - |f - k|). Both operators compute places and weights by the same
/// operations in single precision, so they are transposes to the rounding of sums.
#pragma once

#include <cstdint>
#include <vector>

#include "slicecorr/tomo/volume.hpp"

namespace slicecorr::tomo::detail {

/// A ray of the frame; lengths over the voxel's side, heights over the slice's.
struct WalkRay {
  float cos_turn = 1, sin_turn = 0;
  float t = 0, half = 0;      ///< half 0: the ray misses
  float entry = 0, rise = 0;  ///< slice in which it comes in, and slices per side of u
  float stretch = 1;          ///< its way over its way in the plane
  float share = 0;            ///< weight of one side of its way, where it comes in
};

struct RayWalk {
  TomoGrid grid;
  int per_pixel = 1;
  float alpha = 0;                   ///< per side of a voxel
  std::vector<WalkRay> rays;         ///< [column][row][ray]
  std::vector<double> cosine, sine;  ///< of the angles
  /// [angle][ray]: crossings before the insert; empty: there is none.
  std::vector<std::uint16_t> ends;
};

/// Half-open ranges of rows whose rays come near a slab of slices, per column.
struct RowRange {
  int first = 0, end = 0;
};

/// How many crossings each ray of a frame has before the first that is nearest to an opaque voxel.
void walk_to_shadow(const RayWalk& walk, int angle, const std::uint8_t* opaque,
                    std::uint16_t* ends);
/// light[m][column][row] = A field, of one angle.
void walk_forward(const RayWalk& walk, int angle, const float* field, float* light);
/// Adds A^T light of all angles to slices [first, end) of the field, `end` > `first` + 1.
void walk_adjoint(const RayWalk& walk, int first, int end, const std::vector<RowRange>& rows,
                  const float* light, float* field);

}  // namespace slicecorr::tomo::detail
