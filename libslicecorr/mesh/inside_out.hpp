// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Bodies that are inside out beside others that are not. Where solids overlap, windings add up: of two
/// with opposite ones nothing is left.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <vector>

#include "slicecorr/mesh.hpp"

namespace slicecorr::detail {

struct InsideOut {
  std::size_t bodies = 0;                ///< that lie in no other and are inside out
  std::vector<std::uint32_t> triangles;  ///< of these and of all that lies in no others, rising
};

/// Of a mesh without open edges. `body_of`: a number of each triangle's body, any below the number of
/// triangles. A body whose outermost vertices all lie in others is taken as a hollow of theirs or as
/// being in one, and is left as it is. Where all outer bodies are inside out nothing needs to be turned:
/// the windings of each have one sign then.
InsideOut inside_out(const TriangleMesh& mesh,
                     const std::function<std::uint32_t(std::size_t triangle)>& body_of);

}  // namespace slicecorr::detail
