// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Columns of voxels along z and the pixels that light them: what `make_ray_projector` runs.
#pragma once

#include <vector>

#include "slicecorr/tomo/projection.hpp"

namespace slicecorr::tomo::detail {

/// A column of voxels seen in one direction: parts of the map on its heights, and how wide a voxel is.
struct VoxelColumn {
  int slices = 0, heights = 0;
  const float* parts = nullptr;  ///< as `RayMap::over` says
  const int* height = nullptr;   ///< per slice: the node below, and how far it lies above that
  const float* above = nullptr;
  float one_mm = 0, other_mm = 0;  ///< of the sides, across the light
  float turn_mm = 0;               ///< the way while the vial turns
  float side_mm = 0, height_mm = 0;
  int columns = 0, rows = 0;         ///< pixels
  float lit_across = 1, lit_up = 1;  ///< `PixelProfile`s of these
  float soft_across = 0, soft_up = 0;
};

/// Pixels that a column of voxels meets: of voxel z columns first_column[z] to + across - 1, rows
/// first_row[z] to + up - 1.
struct Footprints {
  int across = 0, up = 0;
  std::vector<int> first_column, first_row;
  Array<float> column_shares, row_shares;  ///< [tap][slice]; rows' hold the light, too
  Array<float> parts;                      ///< scratch: columns, rows and light of the slices
};

/// At most `across` and `up` taps; where pixels lie beside the image, the places are kept next to it.
void make_footprints(const VoxelColumn& voxels, int most_across, int most_up, Footprints& out);

/// Columns, rows and light of the slices of a column of voxels, one after another.
void places_of(const VoxelColumn& voxels, float* parts);

/// field[z] += sum of weights times light[column * stride + row].
void gather_footprints(const Footprints& f, int slices, int stride, const float* light,
                       float* field);
/// The same the other way.
void scatter_footprints(const Footprints& f, int slices, int stride, const float* field,
                        float* light);

/// Shares of frames first + s in the light of a column of pixels: to[s][row] becomes C at the end of
/// frame s less that at its beginning. `at` is where in steps the cell's light lies, row by row.
void frame_shares(const float* at, int rows, float one, float other, int first, int count,
                  float* to);
/// to[i] += share[i] from[i].
void add_shares(const float* share, const float* from, int count, float* to);

}  // namespace slicecorr::tomo::detail
