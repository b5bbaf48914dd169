// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "correct/inhibited_polish.hpp"

#include <algorithm>

namespace slicecorr::detail {

void ColumnPolish::descend(double dip_weight) {
  dip_weight_ = dip_weight;
  const InhibitedTuning& t = plan_.tuning;
  const int farthest = design_.last_node + plan_.reach + plan_.lags.front() + t.spare_slices;
  const int end = std::min(farthest + 1, plan_.all_layers);
  for (int sweep = 0; sweep < t.polish_sweeps; ++sweep) {
    bool moved = false;
    for (int n = end; n-- > 0;) moved = improve(n) || moved;
    doses_.rebuild();
    if (!moved) break;
  }
}

/// Gives slice n, or slices n and n - 1, the levels that cost least; false if they stay as they
/// are.
bool ColumnPolish::improve(int n) {
  const InhibitedTuning& t = plan_.tuning;
  const int level = doses_.level(n);
  const double cost = cost_around(n);
  if (cost < t.polish_enough) return false;
  Best best{cost - t.polish_least_gain, level};
  for (const int step : t.polish_steps) {
    try_level(n, level + step, best);
    try_level(n, level - step, best);
  }
  try_level(n, doses_.floor(n), best);
  if (n > 0) {
    const int previous = doses_.level(n - 1);
    for (const int step : t.polish_moves) {
      try_pair(n, level + step, previous - step, best);
      try_pair(n, level - step, previous + step, best);
    }
  }
  if (best.level == level && best.previous < 0) return false;
  doses_.change(n, best.level);
  if (best.previous >= 0) doses_.change(n - 1, best.previous);
  return true;
}

void ColumnPolish::try_level(int n, int level, Best& best) {
  const int now = doses_.level(n);
  if (!is_possible(n, level) || level == now) return;
  doses_.change(n, level);
  const double cost = cost_around(n);
  doses_.change(n, now);
  if (cost < best.cost) best = {cost, level};
}

void ColumnPolish::try_pair(int n, int level, int previous, Best& best) {
  if (!is_possible(n, level) || !is_possible(n - 1, previous)) return;
  const int now = doses_.level(n), previous_now = doses_.level(n - 1);
  doses_.change(n, level);
  doses_.change(n - 1, previous);
  const double cost = cost_around(n);
  doses_.change(n - 1, previous_now);
  doses_.change(n, now);
  if (cost < best.cost) best = {cost, level, previous};
}

/// The weighted squares of what is wrong in the layers within reach of slice n's tables, where the
/// light of the slice counts most.
double ColumnPolish::cost_around(int n) {
  const InhibitedTuning& t = plan_.tuning;
  const int low = n - plan_.near + 1, high = n + 1;
  double cost = 0;
  // Edges are sorted by their nodes.
  const auto& edges = design_.edges;
  const auto first = std::lower_bound(edges.begin(), edges.end(), low,
                                      [](const auto& edge, int node) { return edge.node < node; });
  for (auto edge = first; edge != edges.end() && edge->node < high; ++edge) {
    const double d = doses_.beside(edge->node, edge->aim) - 1.0;
    cost += t.edge_weight * d * d;
  }
  const int begin = std::max(low, 0), end = std::min(high, plan_.all_layers);
  costs_.resize(static_cast<std::size_t>(std::max(0, end - begin)));
  cost_of_layers(
      design_.coverage_from(begin), doses_.middles(begin),
      {t.core_dose, t.core_weight, t.excess_dose, t.excess_weight, t.gap_dose, t.gap_weight},
      costs_);
  for (int k = begin; k < end; ++k) {
    if (doses_.sampled() && design_.full(k)) {
      const double dip = std::max(0.0, t.dip_dose - doses_.least_sampled(k));
      cost += dip_weight_ * dip * dip;
    }
    cost += costs_[static_cast<std::size_t>(k - begin)];
  }
  return cost;
}

}  // namespace slicecorr::detail
