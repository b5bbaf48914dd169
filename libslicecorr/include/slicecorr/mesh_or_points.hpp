// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file mesh_or_points.hpp
/// Reading what scanners write: meshes, and clouds of points.
///
/// Thread-safe. Errors as of `read_mesh`.
#pragma once

#include <string>
#include <vector>

#include "slicecorr/mesh.hpp"

namespace slicecorr {

/// A mesh as `read_mesh` gives it, in the file's unit where it says one, else in numbers as they are; of a PLY or OBJ
/// file without any face all its points as vertices, and no triangle.
TriangleMesh read_mesh_or_points(const std::string& path, const ExecutionContext& context = {},
                                 std::vector<std::string>* notes = nullptr);

}  // namespace slicecorr
