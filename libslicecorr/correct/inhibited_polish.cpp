// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "correct/inhibited_polish.hpp"

#include <algorithm>

namespace slicecorr::detail {

void ColumnPolish::descend(double dip_weight) {
  dip_weight_ = dip_weight;
  const InhibitedTuning& t = plan_.tuning;
  const int farthest = design_.last_node + plan_.reach + plan_.end_lag + t.spare_slices;
  const int end = std::min(farthest + 1, plan_.all_layers);
  for (int sweep = 0; sweep < t.polish_sweeps; ++sweep) {
    bool moved = false;
    read_costs(0, end);
    for (int n = end; n-- > 0;) moved = improve(n) || moved;
    doses_.rebuild();
    if (!moved) break;
  }
}

namespace {

LayerCosts layer_costs(const InhibitedTuning& t) {
  return {t.core_dose, t.core_weight, t.excess_dose, t.excess_weight, t.gap_dose, t.gap_weight};
}

}  // namespace

/// What layers begin .. end - 1 cost.
void ColumnPolish::read_costs(int begin, int end) {
  const auto size = static_cast<std::size_t>(std::max(0, end));
  if (costs_.size() < size) {
    costs_.resize(size);
    dips_.resize(size);
  }
  if (begin >= end) return;
  const auto first = static_cast<std::size_t>(begin);
  cost_of_layers(design_.coverage_from(begin), doses_.middles(begin), layer_costs(plan_.tuning),
                 {&costs_[first], size - first});
  for (int k = begin; k < end; ++k) dips_[static_cast<std::size_t>(k)] = cost_of_dip(k);
}

/// Gives slice n, or slices n and n - 1, the levels that cost least; false if they stay as they
/// are.
bool ColumnPolish::improve(int n) {
  const InhibitedTuning& t = plan_.tuning;
  const int level = doses_.level(n);
  const double cost = cost_around(n);
  if (cost < t.polish_enough) return false;
  Best best{cost - t.polish_least_gain, level};
  doses_.remember(n);
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
  read_costs(std::max(0, n - plan_.near), n + 1);
  return true;
}

void ColumnPolish::try_level(int n, int level, Best& best) {
  if (!is_possible(n, level) || level == doses_.level(n)) return;
  Best tried{0, level};
  tried.cost = cost_of(n, tried, best);
  if (tried.cost < best.cost) best = tried;
}

void ColumnPolish::try_pair(int n, int level, int previous, Best& best) {
  if (!is_possible(n, level) || !is_possible(n - 1, previous)) return;
  Best tried{0, level, previous};
  tried.cost = cost_of(n, tried, best);
  if (tried.cost < best.cost) best = tried;
}

double ColumnPolish::cost_of_edges(int n) const {
  const int low = n - plan_.near + 1;
  double cost = 0;
  // Edges are sorted by their nodes.
  const auto& edges = design_.edges;
  const auto first = std::lower_bound(edges.begin(), edges.end(), low,
                                      [](const auto& edge, int node) { return edge.node < node; });
  for (auto edge = first; edge != edges.end() && edge->node <= n; ++edge) {
    const double d = doses_.beside(edge->node, edge->aim) - 1.0;
    cost += plan_.tuning.edge_weight * d * d;
  }
  return cost;
}

double ColumnPolish::cost_of_dip(int k) const {
  if (!doses_.sampled() || !design_.full(k)) return 0;
  const double dip = std::max(0.0, plan_.tuning.dip_dose - doses_.least_sampled(k));
  return dip_weight_ * dip * dip;
}

/// The weighted squares of what is wrong in the layers within reach of slice n's tables.
double ColumnPolish::cost_around(int n) const {
  double cost = cost_of_edges(n);
  for (auto k = static_cast<std::size_t>(begin_of(n)); k <= static_cast<std::size_t>(n); ++k) {
    cost += dips_[k];
    cost += costs_[k];
  }
  return cost;
}

double ColumnPolish::cost_of(int n, const Best& tried, const Best& best) {
  const int begin = begin_of(n);
  doses_.try_level(n, tried.level);
  if (tried.previous >= 0) doses_.try_level(n - 1, tried.previous);
  const double edges = cost_of_edges(n);
  tried_.resize(static_cast<std::size_t>(n + 1 - begin));
  cost_of_layers(design_.coverage_from(begin), doses_.middles(begin), layer_costs(plan_.tuning),
                 tried_);
  double cost = edges;
  for (const double of_layer : tried_) cost += of_layer;
  // Dips only add to that; the sum below rounds otherwise by far less than 1e-9 of it.
  if (doses_.sampled() && cost < best.cost * (1 + 1e-9)) {
    doses_.try_samples(n, tried.level);
    if (tried.previous >= 0) doses_.try_samples(n - 1, tried.previous);
    cost = edges;
    for (int k = begin; k <= n && cost < best.cost; ++k) {
      cost += cost_of_dip(k);
      cost += tried_[static_cast<std::size_t>(k - begin)];
    }
  }
  doses_.recall();
  return cost;
}

}  // namespace slicecorr::detail
