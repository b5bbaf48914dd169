/// The grey level that a goal asks for; see node_goal.hpp.
#pragma once

#include <cmath>

#include "correct/node_goal.hpp"

namespace slicecorr::detail {

/// The intensity that makes Omega(n) = `dose` from `below`.
inline double intensity_for(const CureModel& model, double dose, double below) {
  return (dose - model.a * below) / model.one_minus_a;
}

/// The grey level for a goal. Levels that reach `least` beat `aim`. Inlined, or the goal would pass
/// through memory.
[[gnu::always_inline]] inline int choose_level(const CorrectionPlan& plan, const Goal& goal,
                                               double below) {
  if (goal.aim == kNoDemand && goal.least == kNoDemand) return 0;
  const LevelTable& levels = plan.levels;
  const CureModel& model = plan.model;
  // Most voxels of a part are exposed fully or not at all.
  if (goal.aim >= model.step(model.phi_max(), below)) return levels.highest();
  const double darkest = model.step(model.phi_min(), below);
  if (goal.aim <= darkest && darkest >= goal.least) return 0;
  const double phi_least = intensity_for(model, goal.least, below);
  const double phi_aim = intensity_for(model, goal.aim, below);
  const LevelTable::Around aims = levels.around(phi_aim);
  int level = aims.at_most;
  if (goal.nearest && level + 1 < levels.size()) {
    const int next = aims.at_least;
    if (levels.phi(next) - phi_aim < phi_aim - levels.phi(level)) level = next;
  }
  if (levels.phi(level) < phi_least) level = levels.at_least(phi_least);
  // Solving for phi and stepping forward round differently: the dose delivered is what counts.
  while (level + 1 < levels.size() && model.step(levels.phi(level), below) < goal.least) {
    level = levels.at_least(std::nextafter(levels.phi(level), 1e308));
  }
  if (goal.gap && level > 0 && model.middle(levels.phi(level), below) >= 1.0) {
    const double open = (1.0 - model.root_a * below) / (1.0 - model.root_a);
    level = levels.at_most(std::nextafter(open, -1.0));
    while (level > 0 && model.middle(levels.phi(level), below) >= 1.0) --level;
  }
  if (goal.top && level > 0 && model.step(levels.phi(level), below) > plan.open_fall(0)) {
    const int lower = levels.at_most(intensity_for(model, plan.open_fall(0), below));
    if (model.middle(levels.phi(lower), below) >= 1.0) level = lower;
  }
  return level;
}

}  // namespace slicecorr::detail
