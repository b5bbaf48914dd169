// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Voxels of parts and inserts on the grid of a vial.
#pragma once

#include "slicecorr/mesh.hpp"
#include "slicecorr/parallel.hpp"
#include "slicecorr/process.hpp"
#include "slicecorr/tomo/npy.hpp"

namespace slicecorr::tomo::detail {

/// From the middle of a voxel of an n x n slice to the axis.
double distance_mm(int n, int x, int y, double voxel_mm);

/// Throws `InputError` for a voxel of an insert all of which lies outside of the resin; x and y may
/// lie beside the grid.
void check_in_vial(int n, int x, int y, int z, double voxel_mm, const Printer& printer);

/// What is no resin in a vial that is not round or has rods: opaque (255) where the middle of a voxel is
/// beyond the wall or in a rod. Throws `InputError` where some of the part is.
Box<std::uint8_t> beside_resin(const Box<std::uint8_t>& part, const Printer& printer,
                               double voxel_mm);

/// Coverage of nx x ny x as many cells as the mesh is high, with its box in their middle. `name`: of
/// the printer, for messages.
Box<std::uint8_t> coverage_of(TriangleMesh mesh, const std::string& name, int nx, int ny,
                              double voxel_mm, const ExecutionContext& context);

}  // namespace slicecorr::tomo::detail
