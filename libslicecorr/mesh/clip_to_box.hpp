// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Bodies cut at the sides of a box.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "slicecorr/mesh.hpp"

namespace slicecorr::detail {

/// Cuts triangles at the sides of a box and moves what lies beyond onto them, so that inside nothing
/// changes and nothing is left outside. Closed bodies stay closed. New corners are added to
/// `corners`; those of the triangles may be used by no others.
void clip_to_box(std::vector<Point3>& corners, std::vector<std::array<std::uint32_t, 3>>& triangles,
                 const Point3& low, const Point3& high);

/// Keeps of a closed body what lies in a box, with new faces where it is cut. New corners are added to
/// `corners`; some may be left that no triangle has.
void keep_in_box(std::vector<Point3>& corners, std::vector<std::array<std::uint32_t, 3>>& triangles,
                 const Point3& low, const Point3& high);

}  // namespace slicecorr::detail
