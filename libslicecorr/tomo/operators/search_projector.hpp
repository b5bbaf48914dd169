// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What light is looked for with: pairs of operators that follow square pixels, boxes of voxels and
/// turns of the vial closely, and quickly. Shares of a direction's light are put on nodes half a voxel
/// apart (node_table.hpp) and are linear between these. Single weights are off by some per cent of the
/// largest; A and A^T take the same ones. Nothing is proven or judged with them.
#pragma once

#include <memory>

#include "slicecorr/tomo/projector.hpp"
#include "slicecorr/tomo/rays.hpp"
#include "tomo/operators/directions.hpp"

namespace slicecorr::tomo::detail {

/// Directions of level light of which neighbours move by at most so many voxels.
Directions search_directions(const TomoGrid& grid, const RayTables& optics, double most_voxels);

/// In place of `make_square_projector`. Between two of its directions light moves by at most so many
/// voxels.
std::unique_ptr<Projector> make_search_projector(const TomoGrid& grid, const RayTables& optics,
                                                 const Volume* insert, double most_voxels);

/// In place of `make_ray_projector`.
std::unique_ptr<Projector> make_ray_search_projector(const TomoGrid& grid, const LabRays& rays,
                                                     const Volume* insert, double most_voxels);

}  // namespace slicecorr::tomo::detail
