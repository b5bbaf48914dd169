// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Cutting doses and targets open.
#pragma once

#include <cstdint>
#include <vector>

#include "slicecorr/tomo/section.hpp"

namespace slicecorr::tomo::detail {

/// What is cut, on one grid of voxels.
struct Solid {
  const Box<float>& dose;
  const Box<std::uint8_t>&part, &insert;
  double voxel_mm = 0, gel_dose = 0, middle_z_mm = 0;
  /// Columns beyond a wall that is not round, which jobs keep among what is no resin; or empty.
  std::vector<bool> beyond{};
  /// What sections are cut down to, where above 0; empty: part, insert, and what gels.
  Box<std::uint8_t> shown{};
};

/// As `sections_of`.
std::vector<PrintSection> cut(const Solid& solid, const std::vector<Plane>& planes);

}  // namespace slicecorr::tomo::detail
