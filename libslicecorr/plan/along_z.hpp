// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Speeds that change from slice to slice, found by light: where lamps stay as they are a slower slice
/// has more light for its bursts, and a faster one less black.
#pragma once

#include <optional>
#include <vector>

#include "plan/planner.hpp"

namespace slicecorr::detail {

struct AlongZ {
  /// Of each slice of the part and some after it; the last holds for later ones.
  std::vector<double> speed_mm_h;
  PlanPoint point;  ///< with all columns
};

/// What bounds the speeds of slices.
struct AlongZBounds {
  double uniform_mm_h =
      0;  ///< what the part keeps everything at: no slice of it goes slower by light
  std::vector<double> most_mm_h;  ///< of each slice, whatever the light
  double acceleration_mm_s2 = 0;  ///< > 0
};

/// Speeds with which the part takes less time than at `uniform_mm_h` and keeps the same, or nothing.
/// Doses couple over bursts, so there is no exact way in slices' own: closed forms give a guess, slices
/// about what fails go slower until nothing does, then blocks of slices are raised while all is kept.
std::optional<AlongZ> speeds_along_z(Planner& planner, const DesignColumns& columns,
                                     const PartHeights& heights, const PlanLight& light,
                                     const PlanAsk& ask, const AlongZBounds& bounds);

}  // namespace slicecorr::detail
