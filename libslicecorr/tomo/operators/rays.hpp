// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What a vial does to the light that meets it at a place.
#pragma once

#include "slicecorr/process.hpp"

namespace slicecorr::tomo::detail {

struct RayAt {
  double weight = 0;    ///< as `RayTables::weight`; 0 where light misses the resin
  double turn_rad = 0;  ///< as `RayTables::turn_rad`
};
/// Of telecentric light q_mm beside the axis. The operators begin at `radius_mm`, the outermost
/// voxels; light dims from the wall on.
RayAt ray_at(const Vial& vial, double n_resin, double q_mm, double alpha_per_mm, double radius_mm);

}  // namespace slicecorr::tomo::detail
