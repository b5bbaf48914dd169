// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "cure/exchanged_gradient.hpp"

#include <algorithm>

#include "slicecorr/units.hpp"

namespace slicecorr::detail {

ExchangedGradient::ExchangedGradient(const CureModel& model, double exchange)
    : keeps_(1 - exchange),
      a_(model.a),
      depth_(model.eta * units::kLn10),
      per_m_(1 / model.m),
      most_(model.phi_max() * model.greatest_ratio()) {}

DoseGradient ExchangedGradient::add(std::vector<Lift>& lifts, const LightGradient& light) const {
  for (Lift& lift : lifts) {
    DoseGradient& g = lift.sum;
    lift.by_exchange = keeps_ * lift.by_exchange - lift.kept;
    lift.kept *= keeps_;
    const double own = lift.kept * light.phi, by_depth = depth_ * a_ * g.dose;
    g.dose = a_ * g.dose + own;
    g.ln_ha = a_ * g.ln_ha + by_depth;
    g.stray = a_ * g.stray + lift.kept * light.stray;
    g.m = a_ * g.m - by_depth * per_m_ + lift.kept * light.m;
    g.variance = a_ * a_ * g.variance + own * own;
    g.exchange = a_ * g.exchange + lift.by_exchange * light.phi;
  }
  // Where all stays the last lift decides.
  if (light.phi > 0 && (keeps_ < 1 || lifts.empty())) {
    lifts.push_back({1, 0, {light.phi, 0, light.stray, light.m, light.phi * light.phi}});
  }
  // More counts at a nearer lift of all light to come: a further one with no more now never decides.
  double most = -1;
  auto kept = lifts.end();
  for (auto lift = lifts.end(); lift-- != lifts.begin();) {
    if (lift->sum.dose <= most) continue;
    most = lift->sum.dose;
    *--kept = *lift;
  }
  lifts.erase(lifts.begin(), kept);
  // As in the dose itself.
  constexpr double nothing = 1e-10;
  const auto counts = [&](const Lift& lift) { return lift.sum.dose + lift.kept * most_ > nothing; };
  lifts.erase(lifts.begin(), std::find_if(lifts.begin(), lifts.end(), counts));
  return lifts.empty() ? DoseGradient{} : lifts.front().sum;
}

}  // namespace slicecorr::detail
