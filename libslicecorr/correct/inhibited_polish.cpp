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
double ColumnPolish::cost_around(int n) const {
  const InhibitedTuning& t = plan_.tuning;
  const int low = n - plan_.near + 1, high = n + 1;
  double cost = 0;
  for (const ColumnDesign::Edge& edge : design_.edges) {
    if (edge.node < low || edge.node >= high) continue;
    const double d = doses_.beside(edge.node, edge.aim) - 1.0;
    cost += t.edge_weight * d * d;
  }
  const int end = std::min(high, plan_.all_layers);
  for (int k = std::max(low, 0); k < end; ++k) {
    const int c = design_.coverage(k);
    const double m = doses_.middle(k);
    if (c == 255) {
      const double dip =
          doses_.sampled() ? std::max(0.0, t.dip_dose - doses_.least_sampled(k)) : 0.0;
      cost += dip_weight_ * dip * dip;
      const double lacks = std::max(0.0, t.core_dose - m);
      const double excess = std::max(0.0, m - t.excess_dose);
      cost += t.core_weight * lacks * lacks + t.excess_weight * excess * excess;
    } else if (c == 0) {
      const double over = std::max(0.0, m - t.gap_dose);
      cost += t.gap_weight * over * over;
    }
  }
  return cost;
}

}  // namespace slicecorr::detail
