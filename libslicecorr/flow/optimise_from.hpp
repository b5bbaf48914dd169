/// The search for a section's light from a light that is nearly right.
#pragma once

#include "slicecorr/flow_section.hpp"

namespace slicecorr::detail {

/// Light that is near to the best already, as of a neighbouring slice: cells, mW/cm².
struct StartLight {
  const std::vector<double>& blue_mw_cm2;
  const std::vector<double>& uv_mw_cm2;
};
/// `optimise_section` at `goal.min_gap_um`, for a light that lasts in the next slices: each cell is to keep its
/// own curing light off the window, beta Iuv >= Ib, wherever resin comes from.
SectionOptimum optimise_section_from(const StartLight& start, const FlowSection& section,
                                     const GapPressure& pressure, const FlowResin& resin,
                                     double speed_mm_h, const SectionGoal& goal,
                                     const ExecutionContext& context);

}  // namespace slicecorr::detail
