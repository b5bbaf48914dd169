// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Descent on what is wrong in a column under inhibiting UV light, for the columns that the rule
/// leaves with wrong voxels: features and gaps thinner than the light can draw.
#pragma once

#include <algorithm>
#include <vector>

#include "correct/inhibited_design.hpp"
#include "correct/inhibited_doses.hpp"

namespace slicecorr::detail {

/// Minimises the sum of weighted squares of what is wrong (InhibitedTuning has the weights and the
/// doses aimed at) by changing the levels of one or two slices at a time. For one thread.
class ColumnPolish {
 public:
  /// `caps`: as for LevelRule.
  ColumnPolish(const InhibitedPlan& plan, const ColumnDesign& design, ColumnDoses& doses,
               const std::vector<Level>& caps = kCapsOfPlan)
      : plan_(plan), design_(design), doses_(doses), caps_(caps) {}

  /// Changes the levels of the doses that it was made with. `dip_weight`: weight of dips inside
  /// layers; counts only where the doses are sampled.
  void descend(double dip_weight);

 private:
  /// Levels of a slice and of the one before it that cost the least of those tried.
  struct Best {
    double cost;
    int level;
    int previous = -1;  ///< level of the slice before; -1: it keeps its own
  };
  void read_costs(int begin, int end);
  bool improve(int n);
  /// Whether slice n can have this level.
  bool is_possible(int n, int level) const {
    return level >= doses_.floor(n) && level <= plan_.cap_of(n, caps_);
  }
  void try_level(int n, int level, Best& best);
  void try_pair(int n, int level, int previous, Best& best);
  /// Layers begin .. end - 1 are within reach of slice n's tables, where the light of the slice counts most.
  int begin_of(int n) const { return std::max(0, n - plan_.near + 1); }
  double cost_of_edges(int n) const;
  double cost_of_dip(int k) const;
  double cost_around(int n) const;
  /// The same with the levels that are tried, in `best`'s place; at least `best.cost` where it is not less.
  double cost_of(int n, const Best& tried, const Best& best);

  const InhibitedPlan& plan_;
  const ColumnDesign& design_;
  ColumnDoses& doses_;
  const std::vector<Level>& caps_;
  double dip_weight_ = 0;
  /// Per layer, with the levels as they are: what its middle costs, and its dips.
  std::vector<double> costs_, dips_;
  std::vector<double> tried_;  ///< what middles cost with levels that are tried
};

}  // namespace slicecorr::detail
