// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "correct/walked_column.hpp"

#include <algorithm>
#include <cstddef>
#include <optional>

#include "correct/column_walk.hpp"
#include "correct/coverage.hpp"
#include "correct/wanted_light.hpp"

namespace slicecorr::detail {

namespace {

class WalkedColumn final : public ColumnSolver {
 public:
  WalkedColumn(const CorrectionPlan& plan, bool wants_doses)
      : plan_(plan),
        // Where doses are wanted none is given up for shelves.
        searches_(plan, false, !wants_doses),
        levels_(static_cast<std::size_t>(std::max(plan.all_layers, 0))) {
    if (wants_doses) wanted_.emplace(plan, searches_);
  }

  const std::vector<Level>& solve(const std::vector<CoverageRun>& runs,
                                  const ColumnBounds& bounds) override;

 private:
  /// phi of a slice, for what it counts.
  double light(int n, int level) const { return plan_.model.ratio(n) * plan_.levels.phi(level); }
  /// Sets out on the way back, with the bounds of doses that are wanted.
  void begin(const std::vector<CoverageRun>& runs, const ColumnBounds& bounds);

  const CorrectionPlan& plan_;
  WalkSearches searches_;
  std::optional<WantedLight> wanted_;
  ColumnWalk walk_;
  std::vector<Level> levels_;
};

void WalkedColumn::begin(const std::vector<CoverageRun>& runs, const ColumnBounds& bounds) {
  const CureModel& model = plan_.model;
  walk_ = {};
  if (wanted_) wanted_->begin(bounds);
  for_each_run(runs, bounds.left_alone, plan_.all_layers,
               [&](const CoverageRun& run, const LeftAloneRun* left) {
                 if (left) {
                   for (int n = run.first; n < run.end; ++n) {
                     walk_.add_left_alone(model, n, light(n, left->level));
                   }
                   return;
                 }
                 walk_.add(run);
                 if (wanted_ && run.coverage == kFull) wanted_->bound(walk_, run.end);
               });
  walk_.begin(plan_.all_layers);
}

const std::vector<Level>& WalkedColumn::solve(const std::vector<CoverageRun>& runs,
                                              const ColumnBounds& bounds) {
  begin(runs, bounds);
  const int all = plan_.all_layers, bath = plan_.model.bath_slices;
  // What leaves the bath when slice k is shown.
  const auto far = [&](int k) {
    const bool leaves = bath > 0 && k + bath < all;
    return leaves ? light(k + bath, levels_[static_cast<std::size_t>(k + bath)]) : 0.0;
  };
  for (int n = all; n-- > 0;) {
    const auto at = static_cast<std::size_t>(n);
    if (walk_.left_alone(n)) {
      levels_[at] = bounds.floors[at];
    } else {
      const int chosen =
          wanted_ ? walk_.choose(searches_, n, far, *wanted_) : walk_.choose(searches_, n, far);
      levels_[at] = plan_.continuous->level_of[static_cast<std::size_t>(chosen)];
    }
    walk_.pass(plan_.model, n, light(n, levels_[at]), far(n));
  }
  return levels_;
}

}  // namespace

std::unique_ptr<ColumnSolver> make_walked_column(const CorrectionPlan& plan, bool wants_doses) {
  return std::make_unique<WalkedColumn>(plan, wants_doses);
}

std::vector<double> solve_walked_exactly(const CorrectionPlan& plan,
                                         const std::vector<CoverageRun>& runs) {
  const int all = plan.all_layers, bath = plan.model.bath_slices;
  WalkSearches searches(plan, true);
  ColumnWalk walk;
  for_each_run(runs, {}, all, [&](const CoverageRun& run, const LeftAloneRun*) { walk.add(run); });
  walk.begin(all);
  std::vector<double> phi(static_cast<std::size_t>(std::max(all, 0)));
  const auto far = [&](int n) {
    const bool leaves = bath > 0 && n + bath < all;
    return leaves ? phi[static_cast<std::size_t>(n + bath)] : 0.0;
  };
  for (int n = all; n-- > 0;) {
    const double light = walk.exact(searches, n, far);
    phi[static_cast<std::size_t>(n)] = light;
    walk.pass(plan.model, n, light, far(n));
  }
  return phi;
}

}  // namespace slicecorr::detail
