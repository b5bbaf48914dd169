// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "correct/coupled_columns.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "correct/inhibited_column.hpp"
#include "cure/spread_band.hpp"
#include "slicecorr/dose.hpp"
#include "slicecorr/gel_time.hpp"

namespace slicecorr::detail {

namespace {

/// Light in the plane is off by about a per cent where it changes from pixel to pixel: edges keep so
/// far from the middles of layers, in layers, and nodes inside features so far above 1, that voxels
/// stay right.
constexpr double kFarthestEdge = 0.2, kInsideDose = 1.01;

/// Slices of half the light after which what is above gels.
int slices_of_half(const CureModel& model, int most) {
  double half = model.phi_max() / 2;
  if (const GelTimeKernel* const kernel = model.gel_time()) {
    half = kernel->phi(kernel->level_mw_cm2(kernel->levels() - 1) / 2);
  }
  BandDose dose(model, 1);
  ImageShowing showing;
  showing.phi = &half;
  // What slices count for is that of those after the last.
  const int last = std::numeric_limits<int>::max() / 2;
  for (int k = 1; k < most; ++k) {
    dose.add_slice(last - k, {&showing, 1});
    if (*dose.upper() >= 1) return k;
  }
  return most;
}

InhibitedTuning careful_tuning(InhibitedTuning tuning) {
  tuning.farthest_edge_layers = {kFarthestEdge, kFarthestEdge / 2, 0};
  tuning.inside_dose = kInsideDose;
  return tuning;
}

InhibitedPlan careful_plan(const CorrectionPlan& columns, double most_dose) {
  InhibitedPlan plan(columns.model, columns.merge_one_slice_gaps, columns.layers,
                     columns.all_layers, careful_tuning(columns.inhibited->tuning));
  return most_dose > 1 ? plan.for_doses(most_dose * plan.node_over_middle) : plan;
}

}  // namespace

const InhibitedPlan& CarefulPlans::of(const CorrectionPlan& columns, double most_dose) {
  const std::lock_guard lock(making_);
  auto& made = made_[&columns];
  if (!made) made = std::make_unique<const InhibitedPlan>(careful_plan(columns, most_dose));
  return *made;
}

bool want_their_light(const CureModel& model) { return model.inhibited() || !model.adds_up(); }

bool can_couple_under_uv(const CureModel& model) {
  return model.inhibited() && model.inhibited()->uv_levels().empty() &&
         model.inhibited()->gap_um() == 0;
}

int slices_to_gel_at_edges_by_columns(const CureModel& model) {
  if (!model.inhibited()) {
    const int least = model.slices_to_gel(std::numeric_limits<int>::max() / 4);
    const int most = std::max(least, static_cast<int>(std::ceil(1 / model.eta)));
    return std::max(least, slices_of_half(model, most));
  }
  const InhibitedPlan plan(model, false, 1, 1);
  const InhibitedKernel& kernel = *model.inhibited();
  const int setting = kernel.strongest_setting(), level = kernel.highest_usable_level(setting);
  const auto fronts = kernel.by_front(kDimmest * kernel.level_mw_cm2(kernel.levels() - 1));
  const FrontLight half = fronts->front_light(0.5 * kernel.level_mw_cm2(level),
                                              kernel.setting_uv_mw_cm2(setting, level));
  const int most = std::max(plan.reach, static_cast<int>(std::ceil(1 / model.eta)));
  double dose = 0;
  int reach = 0;
  for (; reach < most && dose < 1; ++reach) {
    dose += static_cast<double>(half.amount) * fronts->exact(0, half.front, reach + 1.0);
  }
  return std::max(reach, plan.reach) + plan.end_lag + plan.tuning.spare_slices;
}

CoupledColumns::CoupledColumns(const CorrectionPlan& columns, double most_dose, double most_uv)
    : judged(columns.model) {
  const CureModel& model = columns.model;
  if (const InhibitedKernel* const kernel = model.inhibited()) {
    facts = columns.inhibited->facts();
    inhibited.emplace(careful_plan(columns, most_dose));
    for (int level = 0; level < kernel->levels(); ++level) {
      light.push_back(kernel->level_mw_cm2(level));
    }
    judged.law = UnderUv{kernel->by_front(kDimmest * light.back() / most_uv)};
    return;
  }
  tried.emplace(*columns.tried);
  facts = tried->facts();
  tried->careful = true;
  // At outlines half the light comes: bursts take longer.
  if (model.mode == ExposureMode::continuous) {
    tried->burst = std::max(tried->burst, slices_to_gel_at_edges_by_columns(model) + 2);
  }
  if (const GelTimeKernel* const kernel = model.gel_time()) {
    for (int level = 0; level < kernel->levels(); ++level) {
      light.push_back(kernel->level_mw_cm2(level));
    }
    return;
  }
  light = model.level_phi;
}

std::unique_ptr<ColumnSolver> CoupledColumns::solver() const {
  if (inhibited) return std::make_unique<InhibitedColumn>(*inhibited);
  return make_tried_column(*tried);
}

int CoupledColumns::level_of(double its_light) const {
  const auto above = std::lower_bound(light.begin(), light.end(), its_light);
  if (above == light.begin()) return 0;
  if (above == light.end()) return static_cast<int>(light.size()) - 1;
  const auto at = static_cast<int>(above - light.begin());
  return *above - its_light <= its_light - *std::prev(above) ? at : at - 1;
}

}  // namespace slicecorr::detail
