// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Speed against tolerance: what another tolerance would allow, from what a plan has tried already.
#pragma once

#include "plan/planner.hpp"
#include "plan/refuse.hpp"

namespace slicecorr::detail {

/// `ask.tolerance_points` tolerances about the one asked for, and that one. `ranges`: where gaps keep
/// their contrast by closed forms, whatever the tolerance; empty: not known. Takes the points of
/// `planner`, and adds to them.
std::vector<PlanTolerance> tolerance_curve(Planner& planner, const PlanAsk& ask,
                                           const std::vector<PlanGap>& gaps, const Bound& bound);

}  // namespace slicecorr::detail
