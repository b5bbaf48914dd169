// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Meshes with shorter edges, for maps that bend straight lines.
#pragma once

#include "slicecorr/mesh.hpp"

namespace slicecorr::detail {

/// Splits edges that are longer than `longest_mm` along x and y, at their middles, until none is. Both
/// triangles of an edge get the same new corner, so what was closed stays closed; shares stay. Throws
/// `InputError` where that takes more than 4e9 corners.
TriangleMesh refined(TriangleMesh mesh, double longest_mm);

}  // namespace slicecorr::detail
