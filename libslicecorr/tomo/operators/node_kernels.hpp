// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Columns of voxels along z in light on nodes: what `make_ray_search_projector` runs.
#pragma once

#include <cstddef>

namespace slicecorr::tomo::detail {

/// Where a column of voxels lies among the nodes.
struct NodeColumn {
  int slices = 0;
  const float *column = nullptr, *row = nullptr, *light = nullptr;  ///< per slice, in pixels
  float first_column = 0, by_column = 1;  ///< of nodes: the first, and how many to a pixel
  float first_row = 0, by_row = 1;
  int columns = 0, rows = 0;  ///< of nodes
};

/// field[z] += light[z] times what is linear between the nodes, [column][row].
void gather_nodes(const NodeColumn& at, const float* nodes, float* field);
/// The same the other way.
void scatter_nodes(const NodeColumn& at, const float* field, float* nodes);

}  // namespace slicecorr::tomo::detail
