// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// The search for a section's light from a light that is nearly right.
#pragma once

#include "slicecorr/flow_section.hpp"

namespace slicecorr::detail {

/// Light that is near to the best already, as of a neighbouring slice: cells, mW/cm².
struct StartLight {
  const std::vector<double>& blue_mw_cm2;
  const std::vector<double>& uv_mw_cm2;
  /// Cells are to keep their curing light off the window each by itself, beta Iuv >= Ib, wherever resin
  /// comes from: such a light lasts in the next slices.
  bool holds_off = false;
};
/// `optimise_section` at `goal.min_gap_um` from a light that is nearly right.
SectionOptimum optimise_section_from(const StartLight& start, const FlowSection& section,
                                     const GapPressure& pressure, const FlowResin& resin,
                                     double speed_mm_h, const SectionGoal& goal,
                                     const ExecutionContext& context);

}  // namespace slicecorr::detail
