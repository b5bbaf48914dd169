// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Necks of one voxel among what a coupled correction leaves liquid: such a voxel alone may be all that a
/// body hangs by, so that it counts more than others that are wrong.
#pragma once

#include <bitset>
#include <vector>

#include "correct/coupled_patch.hpp"

namespace slicecorr::detail {

/// What of a voxel and those around it is solid: x + 1 + 3 (y + 1) + 9 (z + 1), itself at 13.
using VoxelsAround = std::bitset<27>;
/// Whether voxels that share a face with it hang together through nothing else around it.
bool joins_alone(const VoxelsAround& solid);

/// Of `misses` of a box, from the last slice to the first, the features that do not print, though they alone
/// join what is around them: of the design, where it covers half of a voxel or more, or of what of it prints
/// beside them. Slice 0 lies on the platform. `coverage`: of the box and a pixel around it.
std::vector<Miss> lost_necks(const CoupledPlan& plan, const PixelBox& box,
                             const std::vector<Miss>& misses,
                             const std::vector<PatchBytes::Source>& coverage);

}  // namespace slicecorr::detail
