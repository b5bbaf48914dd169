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

/// Coverage around node n: layers n - 2, n - 1 (above) and n, n + 1 (below). Outside the part 0.
struct Around {
  std::uint8_t above2, above, below, below2;
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
};

/// `below_dose` is Omega(n + 1); `edge` is 1, with the margin that covers rounding.
inline Goal goal_at(const CorrectionPlan& plan, int n, Around c, Demand demand, double below_dose,
                    double edge) {
  if (c.below == kFull) {
    const int from_top = n - demand.node;
    const double falling = demand.node == 0 ? std::numeric_limits<double>::infinity()
                                            : plan.fall[static_cast<std::size_t>(from_top)];
    return {edge, std::min(plan.omega_max, falling), false};
  }
  if (n > 0 && c.above == kFull) {
    const bool one_slice_gap = c.below == 0 && c.below2 == kFull;
    if (one_slice_gap && !plan.merge_one_slice_gaps) return {};
    return {edge, 1.0, false};
  }
  double least = kNoDemand;
  if (demand.node >= 0) {
    least = plan.needed(demand.dose == 1.0F ? edge : demand.dose, n - demand.node);
  }
  if (c.below != 0) {
    const double own = aim_of(c.below);
    const double other = n > 0 ? aim_of(c.above) : 0.0;
    double aim = (1.0 + plan.model.root_a) * own - plan.model.root_a * below_dose;
    aim = std::min(aim, std::max(own, other));
    if (other > 0) aim = std::max(aim, std::min(own, other));
    return {least, aim, true};
  }
  return {least, least, false};
}

}  // namespace slicecorr::detail
