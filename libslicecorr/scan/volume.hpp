// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Volumes of grey values, slice by slice.
#pragma once

#include <string>
#include <vector>

#include "slicecorr/mesh.hpp"

namespace slicecorr::detail {

/// A folder, or an array of NumPy.
bool is_volume(const std::string& path);

/// Where a volume passes its threshold between neighbouring voxels, in voxels: x, y against the rows, z along the slices.
/// `most`: of more points every second is left out, as often as needed. `notes` gets what was found.
std::vector<Point3> points_of_volume(const std::string& path, std::size_t most,
                                     std::vector<std::string>& notes,
                                     const ExecutionContext& context);

/// The threshold between two of `counts`' bins that leaves the least variance within both sides (Otsu 1979): the number of
/// bins below it.
std::size_t otsu(const std::vector<double>& counts);

}  // namespace slicecorr::detail
