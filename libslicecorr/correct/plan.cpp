// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <algorithm>
#include <utility>

#include "correct/band_solvers.hpp"
#include "correct/column_walk.hpp"
#include "correct/continuous_plan.hpp"
#include "correct/inhibited_plan.hpp"
#include "correct/tried_column.hpp"
#include "slicecorr/correct.hpp"

namespace slicecorr {

CorrectionPlan::CorrectionPlan(CureModel cure_model, const Process& correction_process,
                               int target_layers, int all_slices)
    : model(std::move(cure_model)),
      levels(model.level_phi),
      process(correction_process),
      merge_one_slice_gaps(process.one_slice_gaps == OneSliceGaps::merge),
      layers(target_layers),
      all_layers(all_slices) {
  if (model.inhibited()) {
    inhibited = std::make_shared<const detail::InhibitedPlan>(model, merge_one_slice_gaps, layers,
                                                              all_layers);
  }
  if (!model.adds_up()) {
    tried = std::make_shared<const detail::TriedPlan>(model, process, layers, all_layers);
  }
  if (model.is_continuous()) {
    continuous = std::make_shared<const detail::ContinuousPlan>(model, process, all_layers, false);
    if (model.mirrored_slices > 0) {
      mirrored = std::make_shared<const detail::MirroredPlans>(model, process, all_layers, false,
                                                               continuous);
    }
  }
}

int slices_with_burst(const CureModel& model, int target_layers, int last_lit) {
  if (model.inhibited()) return detail::inhibited_slices(model, target_layers, last_lit);
  // Where levels are tried, an edge half a slice after its node takes one more.
  const int spare = !model.adds_up() && model.mode == ExposureMode::continuous ? 1 : 0;
  return std::max(target_layers, last_lit + 1 + model.slices_to_gel(last_lit + 1) + spare);
}

}  // namespace slicecorr
