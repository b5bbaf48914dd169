// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "correct/coupled_uv.hpp"

#include <algorithm>
#include <cmath>

#include "cure/spread_band.hpp"
#include "slicecorr/dose.hpp"

namespace slicecorr::detail {

namespace {

/// Light in the plane is off by about a per cent where it changes from pixel to pixel: edges keep so
/// far from the middles of layers, in layers, and nodes inside features so far above 1, that voxels
/// stay right.
constexpr double kFarthestEdge = 0.2, kInsideDose = 1.01;

InhibitedTuning careful_tuning(InhibitedTuning tuning) {
  tuning.farthest_edge_layers = {kFarthestEdge, kFarthestEdge / 2, 0};
  tuning.inside_dose = kInsideDose;
  return tuning;
}

}  // namespace

bool can_couple_under_uv(const CureModel& model) {
  return model.inhibited() && model.inhibited()->uv_levels().empty() &&
         model.inhibited()->gap_um() == 0;
}

int slices_to_gel_at_edges_under_uv(const CureModel& model) {
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
  return std::max(reach, plan.reach) + plan.lags.front() + plan.tuning.spare_slices;
}

CoupledUv::CoupledUv(const CorrectionPlan& columns)
    : plan(*columns.inhibited),
      careful(columns.model, columns.merge_one_slice_gaps, columns.layers, columns.all_layers,
              careful_tuning(plan.tuning)),
      by_front(columns.model) {
  const InhibitedKernel& kernel = *columns.model.inhibited();
  for (int level = 0; level < kernel.levels(); ++level) {
    blue.push_back(kernel.level_mw_cm2(level));
  }
  by_front.law = UnderUv{kernel.by_front(kDimmest * blue.back())};
}

int CoupledUv::level_of(double blue_mw_cm2) const {
  const auto above = std::lower_bound(blue.begin(), blue.end(), blue_mw_cm2);
  if (above == blue.begin()) return 0;
  if (above == blue.end()) return static_cast<int>(blue.size()) - 1;
  const auto at = static_cast<int>(above - blue.begin());
  return *above - blue_mw_cm2 <= blue_mw_cm2 - *std::prev(above) ? at : at - 1;
}

}  // namespace slicecorr::detail
