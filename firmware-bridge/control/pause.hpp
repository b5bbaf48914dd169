// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Where a print can stand still without a mark.
#pragma once

#include <string>

#include "slicecorr/bridge/plan.hpp"

namespace slicecorr::bridge {

struct PausePlace {
  bool possible = false;
  double stop_um = 0;  ///< where the stage stops
  std::string why;     ///< why it can't stop now, and where it could next
};

/// Continuous: the stage is at `stage_um` with the print's speed; `shown` is the frame on the
/// display.
PausePlace pause_place(const PrintPlan& plan, const Machine& machine, double stage_um,
                       bool dry_run);

}  // namespace slicecorr::bridge
