// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What closed forms say of a part: its gaps and features, and the speeds that keep them.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "plan/design_columns.hpp"
#include "slicecorr/plan.hpp"

namespace slicecorr::detail {

/// The heights of a part's gaps and features, the lowest first; pixels counted.
struct PartHeights {
  std::vector<PlanGap> gaps;
  std::vector<PlanFeature> features;
  /// Of each column the lowest gap that is planned for and the lowest feature, slices; a large number
  /// where it has none.
  std::vector<int> lowest_gap, lowest_feature;
  /// Of each slice the lowest gap between features, and the lowest from the platform, that is planned
  /// for and that it lies in; 0: none.
  std::vector<int> gap_at, platform_gap_at;
};
/// `least_gap_slices`: lower ones are left out.
PartHeights heights_of(const DesignColumns& columns, int least_gap_slices);

/// Speeds that keep the contrast in all gaps that are planned for, and the tolerance.
std::vector<SpeedRange> closed_ranges(const PlanLight& light, const std::vector<PlanGap>& gaps,
                                      const PlanAsk& ask);
/// The gap that is planned for and limits most: the lowest between two features, else the lowest at the
/// platform; null: there is none.
const PlanGap* limiting_gap(const std::vector<PlanGap>& gaps);

/// What other inputs would buy; `stage_mm_h`: most, 0: none.
std::vector<PlanStep> next_steps(const PlanLight& light, double m, const PlanGap* gap,
                                 const PlanAsk& ask, double most_mm_h);

}  // namespace slicecorr::detail
