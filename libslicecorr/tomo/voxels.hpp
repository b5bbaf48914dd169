/// Voxels of parts and inserts on the grid of a vial.
#pragma once

#include "slicecorr/process.hpp"

namespace slicecorr::tomo::detail {

/// From the middle of a voxel of an n x n slice to the axis.
double distance_mm(int n, int x, int y, double voxel_mm);

/// Throws `InputError` for a voxel of an insert all of which lies outside of the resin; x and y may
/// lie beside the grid.
void check_in_vial(int n, int x, int y, int z, double voxel_mm, const Printer& printer);

}  // namespace slicecorr::tomo::detail
