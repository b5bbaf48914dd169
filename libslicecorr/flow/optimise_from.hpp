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
  /// Above 0: cells are to keep their curing light off the window each by itself, Ib at most this share of
  /// beta Iuv, wherever resin comes from: such a light lasts in the next slices (1), and before the flow is
  /// steady (less).
  double holds_off = 0;
};
/// `optimise_section` at `goal.min_gap_um` from a light that is nearly right.
SectionOptimum optimise_section_from(const StartLight& start, const FlowSection& section,
                                     const GapPressure& pressure, const FlowResin& resin,
                                     double speed_mm_h, const SectionGoal& goal,
                                     const ExecutionContext& context);

}  // namespace slicecorr::detail
