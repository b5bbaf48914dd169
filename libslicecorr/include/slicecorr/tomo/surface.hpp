// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file tomo/surface.hpp
/// Voxels that a part fills in part, judged as what they are: by how much of each has the gel dose. Ours.
///
/// Within a voxel the dose is taken to be linear, with the slopes of its neighbours; its share at or above the
/// gel dose is counted at 6 x 6 x 6 points. Printed less wanted share, times the side of a voxel, is about how
/// far the surface stands out. Thread-safe.
#pragma once

#include <cstddef>
#include <cstdint>

#include "slicecorr/tomo/npy.hpp"

namespace slicecorr::tomo {

struct SurfaceFigures {
  std::size_t voxels = 0;  ///< of the surface: neither all part nor all void, and in the resin
  double mean_um = 0;  ///< by which the surface stands out, in the mean; below 0: it stands back
  double rms_um = 0;   ///< of each voxel of it
};

/// `part`: 255 part, 0 void, between: as much of the voxel is part. Voxels at the outer faces of the volume,
/// and those of `insert` (> 0; may be empty), are left out.
SurfaceFigures surface_of(const Box<float>& dose, const Box<std::uint8_t>& part,
                          const Box<std::uint8_t>& insert, double voxel_mm, double gel_dose);

}  // namespace slicecorr::tomo
