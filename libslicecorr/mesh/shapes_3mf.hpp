// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Triangles of what a 3MF says in other words: beams with balls, and slices on top of each other.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <vector>

#include "mesh/model_3mf.hpp"

namespace slicecorr::detail {

/// Closed bodies that share no vertices and may overlap; the solid is their union.
struct Bodies3mf {
  std::vector<Point3> vertices;
  std::vector<std::array<std::uint32_t, 3>> triangles;
};

/// How far the faces of round beams may lie beside their surface, where they print.
inline constexpr double kBeamToleranceMm = 0.004;

/// Adds the beams between vertices of `object`, whose own lattice they are. No face lies further from
/// the round surface than `tolerance`, in the file's units, on either side; a beam and a ball have
/// the volume of the round ones. What lies outside of `box`, where there is one, is left out.
/// Returns how many beams are too short to count. Throws `std::length_error` where they take more
/// triangles than `most`.
std::size_t add_beams(const Object3mf& object, double tolerance, std::size_t most,
                      const std::optional<std::array<Point3, 2>>& box, Bodies3mf& bodies);

/// Adds slices as prisms from `bottom` up. Their contours are filled by the non-zero rule, as all that
/// is sliced.
void add_slices(const std::vector<Slices3mf::Slice>& slices, double bottom, Bodies3mf& bodies);

/// Twice the area that the contours of a slice enclose; negative where they run the wrong way.
double doubled_area(const Slices3mf::Slice& slice);

}  // namespace slicecorr::detail
