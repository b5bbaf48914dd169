// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Writing triangles to STL, PLY and 3MF files.
#pragma once

#include <cstdint>
#include <functional>
#include <string>

#include "slicecorr/parallel.hpp"
#include "solid/level_surface.hpp"

namespace slicecorr::detail {

enum class MeshFormat { stl, ply, three_mf };

/// By the end of the name; throws `InputError`.
MeshFormat mesh_format(const std::string& path);

/// Calls its argument with every triangle, in order.
using Triangles = std::function<void(const LevelSurface::Sink&)>;

/// Writes `count` triangles to a temporary file beside `path`, then renames it.
void write_triangles(const std::string& path, MeshFormat format, std::uint64_t count,
                     const Triangles& triangles, const ExecutionContext& context);

/// `count` triangles with their corners merged where they are at the same place.
TriangleMesh merge_corners(const Triangles& triangles, std::uint64_t count);

}  // namespace slicecorr::detail
