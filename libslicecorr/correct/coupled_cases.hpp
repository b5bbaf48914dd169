// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Robust corrections where light spreads: what fails in the weak and in the strong case, and the doses that
/// are wanted for it.
///
/// A case is a print of its own, so its doses are those of patches by a plan of its own. What fails says
/// what its best voxel is to have with inputs as said: the node of a feature that comes nearest to gelling
/// in the weak case as much more as it lacks there, the layer of a gap that comes nearest to staying open in
/// the strong case as much less as it has too much; the edges beside that gap may have less than 1 for it.
/// These aims are bounds of doses like those of the design, and rounds go on with them.
#pragma once

#include <algorithm>
#include <cstdint>
#include <vector>

#include "correct/coupled_patch.hpp"

namespace slicecorr::detail {

/// What fails in a column: the voxel that is nearest to holding, with its dose in the case and as said.
struct CaseTrouble {
  std::int32_t slice = 0, x = 0, y = 0;
  bool gap = false;
  double dose = 0, as_said = 0;
  std::int32_t top = 0, bottom = 0;  ///< its nodes
  bool fails_as_said = false;        ///< with inputs as said, too
};

/// Doses that are wanted, as bytes: 0: what the design asks for. Odd ones below 1 are those of edges that give
/// way, which nothing fails to have; odd ones of at least 1 those of necks, which count more than all else.
std::uint8_t aim_byte(double dose, bool gap);
inline std::uint8_t edge_byte(double dose) {
  return static_cast<std::uint8_t>(std::min<int>(aim_byte(dose, true), 126) | 1);
}
inline bool gives_way(std::uint8_t byte) { return (byte & 1) != 0 && byte < 128; }
inline std::uint8_t neck_byte(double dose) {
  return static_cast<std::uint8_t>(std::max<int>(aim_byte(dose, false), 128) | 1);
}
inline bool is_neck(std::uint8_t byte) { return (byte & 1) != 0 && byte > 128; }
inline double aim_of_byte(std::uint8_t byte) { return 1 + ((byte & ~1) - 128) / 400.0; }

/// What fails in `box`. The plans are those of inputs as said and of both cases.
struct CasePlans {
  const CoupledPlan &as_said, &weak, &strong;
};
std::vector<CaseTrouble> judge_cases(const CasePlans& plans, const PixelBox& box,
                                     const PatchSources& sources);

}  // namespace slicecorr::detail
