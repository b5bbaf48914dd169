// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// The pair of operators of level light from square pixels, averaged over voxels and over the time
/// for which frames are shown:
///   D[v] = sum_k sum_i F(v, k, i) e^(-alpha u) weight_i e^(-alpha sqrt(R^2 - t_i^2)) L[k, i],
///   L[k, i] = sum_m share(k, i, m) b[m, i] / cells,
/// F the share of the voxel that pixel i lights in the directions of cell k (footprint.hpp), `share`
/// that of frame m in what the pixel shows meanwhile (directions.hpp). A takes the same weights the
/// other way.
#pragma once

#include <memory>

#include "slicecorr/tomo/projector.hpp"

namespace slicecorr::tomo::detail {

/// Lines of `optics` must be as far apart as the grid's pixels. A voxel is dark behind opaque voxels
/// (coverage > 0) of `insert`, which has this grid and may be null, as seen from its middle.
std::unique_ptr<Projector> make_square_projector(const TomoGrid& grid, const RayTables& optics,
                                                 const Volume* insert);

}  // namespace slicecorr::tomo::detail
