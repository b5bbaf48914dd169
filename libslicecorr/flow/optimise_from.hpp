/// The search for a section's light from a light that is nearly right.
#pragma once

#include "slicecorr/flow_section.hpp"

namespace slicecorr::detail {

/// `optimise_section` at `goal.min_gap_um`, where light is near to the best already, as of a neighbouring
/// slice: cells, mW/cm².
struct StartLight {
  const std::vector<double>& blue_mw_cm2;
  const std::vector<double>& uv_mw_cm2;
  /// Cells are to keep their curing light off the window each by itself, beta Iuv >= Ib, wherever resin
  /// comes from.
  bool holds_off = false;
};
SectionOptimum optimise_section_from(const StartLight& start, const FlowSection& section,
                                     const GapPressure& pressure, const FlowResin& resin,
                                     double speed_mm_h, const SectionGoal& goal,
                                     const ExecutionContext& context);

}  // namespace slicecorr::detail
