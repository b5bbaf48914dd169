/// The rule of the correction at one node; see slicecorr/correct.hpp.
#pragma once

#include <algorithm>
#include <cstdint>
#include <limits>

#include "slicecorr/correct.hpp"

namespace slicecorr::detail {

inline constexpr std::uint8_t kFull = 255;
inline constexpr double kNoDemand = -std::numeric_limits<double>::infinity();

/// The last node that demands something of the nodes after it. In a feature: its upper edge.
struct Demand {
  std::int32_t node = kNone;
  float dose = 0;  ///< the dose demanded there; 1 at edges of features
  static constexpr std::int32_t kNone = -(1 << 29);
  bool operator==(const Demand&) const = default;
};

/// Coverage around node n: layers n - 3, n - 2, n - 1 (above) and n, n + 1 (below). Outside the
/// part 0.
struct Around {
  std::uint8_t above3, above2, above, below, below2;
};

/// Relative dose that a coverage aims at.
inline double aim_of(std::uint8_t coverage) { return coverage / 255.0; }

/// Dose at the lower node of a grey layer under a full one, so that its middle gets its coverage:
/// the middle is (Omega(n) + r Omega(n + 1)) / (1 + r), r = sqrt(a), and Omega(n) = 1.
inline double grey_under_full(const CureModel& model, std::uint8_t coverage) {
  return ((1.0 + model.root_a) * aim_of(coverage) - 1.0) / model.root_a;
}

/// The demand after node n, given the one before it. First pass, first node to last.
inline Demand next_demand(const CorrectionPlan& plan, int n, Around c, Demand before) {
  if (c.below == kFull) return c.above == kFull && n > 0 ? before : Demand{n, 1.0F};
  if (n == 0) return {};
  if (c.above == kFull) return {n, 1.0F};
  if (c.above == 0) return before;
  const double own = c.below != 0                 ? std::min(aim_of(c.above), aim_of(c.below))
                     : c.above2 == kFull && n > 1 ? grey_under_full(plan.model, c.above)
                                                  : aim_of(c.above);
  const double carried = before.node >= 0 ? plan.needed(before.dose, n - before.node) : kNoDemand;
  return own > carried ? Demand{n, static_cast<float>(own)} : before;
}

/// What to make of Omega(n): at least `least`; of the doses that fulfil this the greatest up to
/// `aim`, or, when `nearest`, the one nearest to it.
struct Goal {
  double least = kNoDemand;
  double aim = kNoDemand;
  bool nearest = false;
  /// Where levels are too coarse to fulfil `least` and keep a gap open, the gap stays open, as long
  /// as the feature's voxel prints all the same. `gap`: this layer is a gap. `top`: the layer above
  /// is one.
  bool gap = false, top = false;
};

/// `below_dose` is Omega(n + 1); `edge` is 1, with the margin that covers rounding.
[[gnu::always_inline]] inline Goal goal_at(const CorrectionPlan& plan, int n, Around c,
                                           Demand demand, double below_dose, double edge) {
  if (c.below == kFull) {
    const bool platform = demand.node == 0;
    const double falling =
        platform ? plan.platform_omega_max
                 : std::min(plan.omega_max, plan.fall[static_cast<std::size_t>(n - demand.node)]);
    Goal goal{edge, falling};
    goal.top = n > 0 && c.above == 0;
    if (below_dose < edge) {
      // The lower edge was given up for an open gap: this layer prints if its middle does.
      const double r = plan.model.root_a;
      const double middle = edge + r * (edge - below_dose);
      const double most = platform ? middle : plan.open_fall(n - demand.node);
      goal.least = std::max(edge, std::min(middle, most));
    }
    if (goal.top && c.above2 == kFull && c.above3 != kFull && n > 2 && !plan.merge_one_slice_gaps) {
      // A feature one slice high above a gap one slice high: both edges of the gap give way alike,
      // or the feature would lose its middle.
      // Two level steps are left for the gap's own light.
      goal.aim = std::max(goal.aim, plan.open_fall(0) - 2 * plan.level_step);
    }
    return goal;
  }
  Goal goal;
  goal.gap = c.below == 0;
  if (n > 0 && c.above == kFull) {
    const bool one_slice_gap = c.below == 0 && c.below2 == kFull;
    if (one_slice_gap && !plan.merge_one_slice_gaps) {
      if (c.above2 != kFull && n > 1) {
        // The feature above is one slice high: it prints in its middle if enough dose reaches its
        // lower node that one level step at its upper node can't close the gap above it.
        const double r = plan.model.root_a;
        goal.least = goal.aim = (1.0 + r - plan.open_fall(0) + plan.level_step) / r;
      }
      return goal;
    }
    goal.gap = goal.gap && !one_slice_gap;
    goal.least = edge;
    goal.aim = 1.0;
    return goal;
  }
  if (demand.node >= 0) {
    goal.least = plan.needed(demand.dose == 1.0F ? edge : demand.dose, n - demand.node);
  }
  goal.aim = goal.least;
  if (c.below != 0) {
    const double own = aim_of(c.below);
    const double other = n > 0 ? aim_of(c.above) : 0.0;
    goal.nearest = true;
    goal.aim = (1.0 + plan.model.root_a) * own - plan.model.root_a * below_dose;
    goal.aim = std::min(goal.aim, std::max(own, other));
    if (other > 0) goal.aim = std::max(goal.aim, std::min(own, other));
  }
  return goal;
}

}  // namespace slicecorr::detail
