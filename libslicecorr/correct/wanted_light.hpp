// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Levels of columns of whose features doses are wanted (docs/graded-dose.md), continuous exposure.
///
/// Of each node inside a feature a dose is wanted, between those of the two layers beside it. Light
/// between black and full can't follow all that these may do: the least doses that are nowhere
/// below them, and the greatest that are nowhere above them, are found from the platform on, as far
/// as the edges at the ends of the feature leave room. Then the slices are chosen from the last one
/// on, each from the dose that is there.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "correct/column_solver.hpp"
#include "correct/column_walk.hpp"

namespace slicecorr::detail {

/// What a walk chooses by, as BrightLevels. For one thread.
class WantedLight {
 public:
  /// Both outlive it; the searches are without shelves.
  WantedLight(const CorrectionPlan& plan, WalkSearches& searches);

  /// The next column. `bounds.wanted`: of all layers.
  void begin(const ColumnBounds& bounds);
  /// Bounds the doses of the nodes of the feature that was added last, up to its lower end.
  void bound(ColumnWalk& walk, int lower);

  static constexpr bool kLooks = true;
  void look(int n, const WalkAsk& ask) { want_ = light_at(ask, n); }
  int choose(int n, const WalkAsk& ask, LevelSearch& search, std::uint8_t* levels) {
    return search.choose_near(ask.run, n, ask.below, want_, levels, ask.taken);
  }

 private:
  const ContinuousPlan& plan_of(std::size_t search) const {
    return *searches_.plans().plans[search];
  }
  /// Doses of a search over those of resin, at `zeta` slices from the platform.
  double scale_at(std::size_t search, double zeta) const {
    return searches_.plans().factors[search] / model_.returned(zeta);
  }
  double wanted(int layer) const { return bounds_->wanted[static_cast<std::size_t>(layer)]; }
  /// The doses wanted of the node between two layers of a feature: the mean, or, where light can't
  /// follow them, both.
  DoseRange between(std::size_t search, int slice) const;
  LevelSearch::Wanted light_at(const WalkAsk& ask, int n);

  const CureModel& model_;
  WalkSearches& searches_;
  const ColumnBounds* bounds_ = nullptr;  ///< of the column at hand
  /// Per node of a feature: nothing below `least_` leads to doses that are enough everywhere above
  /// it, nothing above `most_` to doses that are nowhere too much.
  std::vector<double> least_, most_;
  std::vector<double> aim_most_;  ///< what slices near edges should not pass
  std::vector<double> scaled_;    ///< the same as the search at hand has it
  /// Doses that are never too low, and never too high, as light from here on can reach them.
  double over_ = 0, under_ = 0;
  LevelSearch::Wanted want_{};  ///< of the slice at hand
};

}  // namespace slicecorr::detail
