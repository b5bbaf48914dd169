// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "correct/wanted_layers.hpp"

#include <algorithm>
#include <cstdint>
#include <limits>

#include "cure/margin.hpp"

namespace slicecorr::detail {

namespace {

constexpr double kUnbounded = std::numeric_limits<double>::infinity();

}  // namespace

WantedLayers::WantedLayers(const CorrectionPlan& plan, const LiftedFeature* lifted)
    : plan_(plan),
      lifted_(lifted),
      least_(static_cast<std::size_t>(std::max(plan.all_layers, 0))),
      most_(least_.size()),
      cap_(least_.size(), kUnbounded) {
  const auto count = static_cast<int>(least_.size());
  // As if the last slice went on.
  brightest_.assign(least_.size() + 1, full(count) / one_minus_a(count));
  darkest_.assign(least_.size() + 1, held(count) * ratio(count) / one_minus_a(count));
  for (int n = count; n-- > 0;) {
    const auto at = static_cast<std::size_t>(n);
    brightest_[at] = full(n) + a(n + 1) * brightest_[at + 1];
    darkest_[at] = held(n) * ratio(n) + a(n + 1) * darkest_[at + 1];
  }
}

double WantedLayers::gels_through(int n) const { return (1.0 + kMargin) / a(n) / returned(n); }

double WantedLayers::held(int n) const {
  if (!lifted_) return phi(0);
  const LiftModel& lifts = *plan_.model.lifts;
  return phi(
      plan_.levels.at_least(lifts.green_strength * (1 + kMargin) / a(n) / ratio(n) / returned(n)));
}

/// From the upper end of the feature to its lower one.
void WantedLayers::bound(const ColumnBounds& bounds) {
  // Without lifts the dose ends at the edge: what it may be at windows further away.
  double cap = kUnbounded;
  for (int n = run_.first; n < run_.end; ++n) {
    const auto at = static_cast<std::size_t>(n);
    const double wanted = bounds.wanted[at] / plan_.model.root_a_of(n) / returned(n + 0.5);
    least_[at] = most_[at] = wanted;
    if (n == run_.first) {
      if (!lifted_ && !run_.free_above) {
        cap = run_.gap_above ? light_of_layer(plan_, run_, n, 0.0).wanted() : gels_through(n);
      }
    } else {
      // What can't be had above, more than all light or less than what holds, is not asked of this layer.
      const double held_above = held(n - 1) * ratio(n - 1);
      least_[at] =
          std::max(wanted, (std::min(least_[at - 1], brightest_[at - 1]) - full(n - 1)) / a(n));
      most_[at] = std::min(wanted, (std::max(most_[at - 1], darkest_[at - 1]) - held_above) / a(n));
      cap = (cap - phi(0) * ratio(n - 1)) / a(n);
    }
    cap_[at] = cap;
    // The far end of each layer gels.
    const double gels = std::min(cap, gels_through(n));
    least_[at] = std::clamp(least_[at], gels, cap);
    most_[at] = std::clamp(most_[at], gels, cap);
  }
}

LiftedFeature::Ask WantedLayers::edge_ask(int n, double after) const {
  return {run_.first, n - run_.first + 1, after, edge_below(run_)};
}

/// With lifts and a gap above: the first layers are as their edge needs them. Where it is put to its
/// place they stay so; where every layer holds they may have less, down to what holds.
WantedLayers::EdgeLevels WantedLayers::edge_levels(double after) const {
  const int layers = std::min(run_.end - run_.first, lifted_->reach());
  const bool whole = layers == run_.end - run_.first;
  const int past = run_.first + layers;
  const double there = whole ? after : a(past) * brightest_[static_cast<std::size_t>(past)];
  const LiftedFeature::Light light = lifted_->solve(edge_ask(past - 1, there));
  EdgeLevels edge;
  for (const double p : light.phi) {
    edge.highest.push_back(static_cast<Level>(plan_.levels.at_least(p)));
  }
  // From the last layer that the edge holds back on, light may be as doses want it; a film is the edge's.
  const std::size_t least = light.liquid > 0 ? static_cast<std::size_t>(light.liquid) + 1 : 0;
  while (edge.highest.size() > least && edge.highest.back() >= plan_.levels.highest()) {
    edge.highest.pop_back();
  }
  return edge;
}

int WantedLayers::level_inside(int n, int lowest, int highest, const LayerWalk& walk) {
  const auto at = static_cast<std::size_t>(n);
  const double left = a(n + 1), r = ratio(n), after = walk.after();
  const double low = phi(lowest) * r - walk.taken(), high = phi(highest) * r - walk.taken();
  if (n + 1 == run_.end) over_ = under_ = after / left;
  const auto reached = [&](double dose, double below) {
    return std::clamp(dose, left * below + low, left * below + std::max(low, high));
  };
  over_ = reached(least_[at], over_);
  under_ = reached(most_[at], under_);
  const auto light = [&](double dose) { return (dose - after) / r; };
  int level = 0;
  switch (side_) {
    case DoseSide::nearest: {
      const double wanted = light((over_ + under_) / 2);
      const auto around = plan_.levels.around(wanted);
      level = phi(around.at_least) - wanted < wanted - phi(around.at_most) ? around.at_least
                                                                           : around.at_most;
      break;
    }
    case DoseSide::at_least:
      level = plan_.levels.at_least(light(least_[at]) * (1 - 1e-12));
      break;
    case DoseSide::at_most:
      level = plan_.levels.at_most(light(most_[at]) * (1 + 1e-12));
      break;
  }
  return std::clamp(level, lowest, std::max(lowest, highest));
}

void WantedLayers::begin(const LayerRun& run, const ColumnBounds& bounds, const LayerWalk& walk) {
  run_ = run;
  side_ = bounds.side;
  over_ = under_ = 0;
  edge_ = lifted_ && !run.free_above ? edge_levels(walk.after()) : EdgeLevels{};
  bound(bounds);
}

int WantedLayers::lifted_level(int n, const LayerWalk& walk) {
  const auto j = static_cast<std::size_t>(n - run_.first);
  if (j + 1 == edge_.highest.size()) {
    // With the dose that comes from below now.
    const LiftedFeature::Ask ask = edge_ask(n, walk.after());
    const LiftedFeature::Light light = lifted_->solve(ask);
    const std::vector<double> least = lifted_->least_light(ask);
    const auto level_of = [&](double p) { return static_cast<Level>(plan_.levels.at_least(p)); };
    edge_.lowest.clear();
    for (std::size_t k = 0; k < light.phi.size(); ++k) {
      edge_.highest[k] = level_of(light.phi[k]);
      edge_.lowest.push_back(least.empty() ? edge_.highest[k] : level_of(least[k]));
    }
  }
  if (j < edge_.highest.size()) {
    return level_inside(n, edge_.lowest[j], edge_.highest[j], walk);
  }
  return level_inside(n, plan_.levels.at_least(held(n)), plan_.levels.highest(), walk);
}

int WantedLayers::level(int n, const LayerWalk& walk) {
  if (lifted_) return lifted_level(n, walk);
  const LayerLight light = light_of_layer(plan_, run_, n, walk.after());
  if (n == run_.first && !run_.free_above) return layer_level(light, kFull);
  const int gels = level_to_node(light, 1.0 + kMargin);
  const double cap = cap_[static_cast<std::size_t>(n)];
  const int most = cap < kUnbounded ? plan_.levels.at_most((cap - walk.after()) / ratio(n))
                                    : plan_.levels.highest();
  return level_inside(n, gels, std::max(gels, most), walk);
}

}  // namespace slicecorr::detail
