// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// How the levels of a column are chosen under inhibiting UV light: slice by slice, from the last
/// one on, for several nodes together. inhibited_column.hpp tells the rule and why.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "correct/inhibited_design.hpp"
#include "correct/inhibited_doses.hpp"

namespace slicecorr::detail {

/// Chooses the levels of a column by the rule. For one thread.
class LevelRule {
 public:
  /// `caps`: highest levels of the column, per slice; empty: those of the plan.
  LevelRule(const InhibitedPlan& plan, const ColumnDesign& design, ColumnDoses& doses,
            const std::vector<Level>& caps = kCapsOfPlan)
      : plan_(plan), design_(design), doses_(doses), caps_(caps) {}

  /// Chooses all levels. The light that a feature will get from features nearer to the platform is
  /// not known yet, and taken for none.
  void choose() { choose_all(false); }
  /// Chooses all levels again, and takes it that features nearer to the platform give the light
  /// that was chosen for them before. Returns whether any node gets such light.
  bool choose_again() {
    before_ = doses_.levels();
    return choose_all(true);
  }

 private:
  using Feature = ColumnDesign::Feature;
  /// What slice n asks for: its level, and whether it lies deep inside a feature.
  struct Slice {
    int level = 0;
    bool deep = false;
    int deep_until = 0;  ///< no edge comes near before this slice
  };
  bool choose_all(bool again);
  int first_affected(bool again) const;
  void take_over(int last, int end);
  int last_asked() const;
  /// Slices beyond a node of the feature that it asks for light.
  int reach_of(const Feature& f) const {
    return plan_.reach + plan_.longest(f.lag) + plan_.tuning.spare_slices;
  }
  /// The feature's own light ends here: slices nearer to the platform are black, or light others.
  int own_until(const Feature& f) const {
    return f.platform ? 0 : f.upper + plan_.lag_from(f.upper, f.lag);
  }
  bool stays(int n, int first_feature, int before) const;
  bool asks_now(const Feature& feature, int first, int nearest, int n) const;
  Slice level_of(int n, int first_feature, bool again);
  struct Asked;
  int level_by_tables(const Asked& by, int level) const;
  int level_for_nodes(const Asked& by, int level);
  int level_for_node(int n, int k, int from, int lag, double need, int level) const;
  double expected(int n, int k, int from) const;
  double promised(int n, int level, int k, int from) const;
  int least_level(int n, int k, double need, int from) const;
  int least_level_above(int level, int end, double need, int first) const;
  double can_still_come(int n, int k, int from, int lag, double enough) const;
  bool even_light_fits(int n, int first_feature);
  double borne_by_edge(const Feature& feature) const;
  int cap_of(int n) const { return plan_.cap_of(n, caps_); }
  /// Whether slices beyond the reach of the tables are summed at once, not one by one.
  bool far_at_once() const { return !plan_.fades.empty() && !doses_.has_floors(); }
  /// The light of slice n when `level` is asked of it.
  int within(int n, int level) const {
    return std::clamp(level, doses_.floor(n), std::max(doses_.floor(n), cap_of(n)));
  }

  const InhibitedPlan& plan_;
  const ColumnDesign& design_;
  ColumnDoses& doses_;
  const std::vector<Level>& caps_;
  /// What was chosen last, and for what: slices that no difference reaches are taken over. Only where
  /// the rule goes by tables.
  struct Chosen {
    std::vector<Level> levels;
    std::vector<double> demand;
    std::vector<Feature> features;
    bool again = false;
  } chosen_;
  std::vector<int> deep_until_;  ///< per slice, as it stood after the slice was chosen
  std::vector<Level> before_;    ///< levels that choose_again() expects
  bool other_light_ = false;     ///< a node gets light of a feature nearer to the platform
  bool by_tables_ = false;       ///< all slices are alike, and the column has no bounds of its own
  int hint_ = 0;                 ///< level of the slice before
  int edge_ = -1;                ///< towards the platform, that was looked at last
  double edge_bears_ = 0;        ///< what even light may give it
};

}  // namespace slicecorr::detail
