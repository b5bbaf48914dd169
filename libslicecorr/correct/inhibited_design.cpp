// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "correct/inhibited_design.hpp"

#include <algorithm>
#include <cmath>

#include "slicecorr/target.hpp"

namespace slicecorr::detail {

ColumnDesign::ColumnDesign(const InhibitedPlan& plan)
    : demand(static_cast<std::size_t>(plan.all_layers) + 2, 0.0),
      plan_(plan),
      coverage_(static_cast<std::size_t>(plan.all_layers) + 1, std::uint8_t{0}),
      heights_(static_cast<std::size_t>(plan.all_layers) + 2, std::uint8_t{0}) {}

void ColumnDesign::read(const std::vector<CoverageRun>& runs, double farthest) {
  farthest_ = farthest;
  take_coverage(runs);
  take_heights(runs);
  std::fill(demand.begin(), demand.end(), 0.0);
  for (const CoverageRun& run : runs) {
    for (int k = run.first; k <= run.end; ++k) {
      double& wanted = demand[static_cast<std::size_t>(k)];
      wanted = std::max(wanted, demand_at(k));
    }
  }
  find_features();
  if (!plan_.merge_one_slice_gaps) open_one_slice_gaps();
  find_edges();
  last_node = features.empty() ? 0 : features.back().lower;
}

void ColumnDesign::take_coverage(const std::vector<CoverageRun>& runs) {
  std::fill(coverage_.begin(), coverage_.end(), std::uint8_t{0});
  for (const CoverageRun& run : runs) {
    std::fill(coverage_.begin() + run.first, coverage_.begin() + run.end, run.coverage);
  }
  if (!plan_.merge_one_slice_gaps) return;
  for (int n = 1; n + 1 < plan_.layers; ++n) {
    if (coverage(n) == 0 && full(n - 1) && full(n + 1)) {
      coverage_[static_cast<std::size_t>(n)] = 255;
    }
  }
}

void ColumnDesign::take_heights(const std::vector<CoverageRun>& runs) {
  std::fill(heights_.begin(), heights_.end(), std::uint8_t{0});
  for (const CoverageRun& run : runs) {
    heights_[static_cast<std::size_t>(run.first)] = run.upper_height;
    heights_[static_cast<std::size_t>(run.end)] = run.lower_height;
  }
}

/// How far below its node an edge belongs, in slices, but no further than `farthest`.
double ColumnDesign::below_node(int node, double farthest) const {
  const std::uint8_t height = heights_[static_cast<std::size_t>(node)];
  return height != 0 ? std::clamp(edge_height_slices(height), -farthest, farthest) : 0.0;
}

/// The relative dose that a node of a feature demands, from the layers on its two sides; see
/// goal_at() for the same without UV.
double ColumnDesign::demand_at(int node) const {
  const int above = coverage(node - 1), below = coverage(node);
  // Between nodes the dose may dip by a little; edges get just what they need.
  if (above == 255 && below == 255) return plan_.inside;
  if (above == 255 || below == 255) {
    // Above a feature nothing is lit: light from below falls by a in a slice.
    return above == 0 ? std::pow(plan_.kernel->a(), below_node(node, farthest_)) : 1.0;
  }
  if (above != 0 && below != 0) return std::min(above, below) / 255.0;
  if (above == 0) return 0;
  // The last grey layer: its middle lies about half way between its two nodes.
  const double share = above / 255.0;
  return full(node - 2) ? std::max(0.0, 2.0 * above / 255.0 - 1.0) : share;
}

void ColumnDesign::find_features() {
  features.clear();
  const int nodes = plan_.layers + 1;
  const auto wanted = [&](int k) { return demand[static_cast<std::size_t>(k)]; };
  for (int k = 0; k < nodes; ++k) {
    if (wanted(k) <= 0) continue;
    Feature feature;
    feature.upper = k;
    // An upper edge inside its layer demands less of its node.
    feature.full = full(k) || wanted(k) >= 1.0;
    // A gap of one layer ends the feature, although both of its nodes have demands.
    while (k + 1 < nodes && wanted(k + 1) > 0 && coverage(k) != 0) {
      ++k;
      feature.full = feature.full && wanted(k) >= 1.0;
    }
    feature.lower = k;
    feature.platform = feature.upper == 0;
    feature.lag = plan_.lags.front();
    features.push_back(feature);
  }
}

/// At a gap of one layer the edge of the feature above gives way, while the middle of that
/// feature's last layer still prints.
void ColumnDesign::open_one_slice_gaps() {
  for (int n = 1; n + 1 < plan_.layers; ++n) {
    if (coverage(n) != 0 || !full(n - 1) || !full(n + 1)) continue;
    demand[static_cast<std::size_t>(n)] = plan_.tuning.slit_edge_dose;
    double& inner = demand[static_cast<std::size_t>(n) - 1];
    inner = std::max(inner, plan_.tuning.slit_inner_dose);
  }
}

void ColumnDesign::find_edges() {
  edges.clear();
  const auto add = [&](int node, bool upper) {
    // Layer by layer, features end at the window.
    const bool at_node = !upper && plan_.kernel->layer_by_layer();
    const double most = at_node ? 0.0 : plan_.tuning.farthest_edge_layers.front();
    const double below = below_node(node, most);
    edges.push_back({node, upper, below, std::clamp(below, -farthest_, farthest_)});
  };
  for (int n = 0; n <= plan_.layers; ++n) {
    // The platform is no gap: a feature that begins there has no upper edge.
    const int above = n > 0 ? coverage(n - 1) : -1, below = coverage(n);
    if (above == 0 && below == 255) add(n, true);
    if (above == 255 && below == 0) add(n, false);
  }
  has_heights =
      std::any_of(edges.begin(), edges.end(), [](const Edge& edge) { return edge.aim != 0; });
}

}  // namespace slicecorr::detail
