// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Correction of pixel columns under inhibiting UV light (physics.md §5 asks for it; the rule is
/// explained in docs/inhibition.md).
///
/// A slice hardly acts on its own node: the kernel is 0 in the dead zone and greatest at z0 above
/// the window. Solving each slice for its own node makes light swing between its limits. So slice n
/// is chosen for the nodes up to `lag` slices above it, together: the least level with which each
/// of them still reaches its dose, if the slices to come keep that level as long as they belong to
/// the same feature, and black after it. A node once promised its dose never asks for more light
/// later than it was promised: levels settle. Lower edges further ahead ask for light as soon as
/// full light from the next slice on would come too late.
///
/// Files: `inhibited_plan` is what all columns share, `inhibited_tuning` the numbers chosen by
/// trial; `inhibited_design` is what a column asks for, `inhibited_doses` its levels and what they
/// give, `inhibited_rule` the rule above, `inhibited_judge` the error by which levels are compared,
/// `inhibited_polish` the descent for columns that the rule leaves with wrong voxels. This file
/// tries lags, raises demands and polishes, and keeps the best levels.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "correct/inhibited_design.hpp"
#include "correct/inhibited_plan.hpp"

namespace slicecorr::detail {

class InhibitedColumn final : public ColumnSolver {
 public:
  explicit InhibitedColumn(const InhibitedPlan& plan);
  ~InhibitedColumn() override;
  const std::vector<Level>& solve(const std::vector<CoverageRun>& runs,
                                  const ColumnBounds& bounds = {}) override;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace slicecorr::detail
