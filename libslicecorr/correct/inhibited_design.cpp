// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "correct/inhibited_design.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "correct/coverage.hpp"
#include "slicecorr/target.hpp"

namespace slicecorr::detail {

ColumnDesign::ColumnDesign(const InhibitedPlan& plan)
    : demand(static_cast<std::size_t>(plan.all_layers) + 2, 0.0),
      plan_(plan),
      coverage_(static_cast<std::size_t>(plan.all_layers) + 1, std::uint8_t{0}),
      heights_(static_cast<std::size_t>(plan.all_layers) + 2, std::uint8_t{0}) {}

void ColumnDesign::ask(const ColumnBounds& bounds) {
  left_alone_.assign(bounds.left_alone.empty() ? 0 : coverage_.size(), kNo);
  for (const LeftAloneRun& run : bounds.left_alone) {
    std::fill(left_alone_.begin() + run.first, left_alone_.begin() + run.end, kYes);
  }
  wanted_ = bounds.wanted;
  side_ = bounds.side;
}

/// Raises the demands of the nodes of full layers first .. end - 1 to the doses that these want, as far
/// as edges to gaps and greys leave room: towards the platform light from below falls by a in a slice at
/// most, and full light adds what the kernel says.
void ColumnDesign::want_doses(int first, int end) {
  const auto count = static_cast<std::size_t>(end - first) + 1;
  // What is left at node k of a dose j layers below it, at least.
  const auto left = [&](int k, int j) {
    const InhibitedKernel& kernel = *plan_.kernel;
    return kernel.alike() ? std::pow(kernel.a(), j)
                          : kernel.fade(kernel.place_um(k + j) - kernel.place_um(k));
  };
  const bool free_above = first == 0 || left_alone(first - 1), free_below = left_alone(end);
  const auto dark = [&](int k) {
    return k < plan_.all_layers ? plan_.dark_node[static_cast<std::size_t>(k)] : 0.0;
  };
  const auto layer = [&](int n) { return wanted_[static_cast<std::size_t>(n)]; };
  const auto at = [&](int k) { return static_cast<std::size_t>(k - first); };
  least_.resize(count);
  most_.resize(count);
  for (int k = first; k <= end; ++k) {
    const double above = layer(std::max(k - 1, first)), below = layer(std::min(k, end - 1));
    least_[at(k)] = std::max(above, below) * plan_.node_over_middle;
    most_[at(k)] = std::min(above, below) * plan_.node_over_middle;
  }
  wanted_most_ = most_;
  // Nothing that is asked for of a node may take the one at an end away from its dose: of the light
  // beyond the lower end a^j is left at least; further up the light of a node does more yet to those
  // nearer to the platform, as far as twice the distance at which it acts most.
  for (int j = 1; !free_below && j <= std::min(plan_.reach, end - first); ++j) {
    const int k = end - j;
    const double other = demand[static_cast<std::size_t>(end)] - dark(end);
    const double cap = dark(k) + plan_.climb(k, j) + left(k, j) * std::max(0.0, other);
    least_[at(k)] = std::min(least_[at(k)], cap);
    most_[at(k)] = std::min(most_[at(k)], cap);
  }
  // Of a rise towards the platform, what begins behind the step.
  for (int k = end; k-- > first;) {
    for (int j = 1; j <= std::min(plan_.reach, end - k); ++j) {
      const double there = wanted_most_[at(k + j)];
      if (there >= wanted_most_[at(k)]) continue;
      const double lower = std::max(0.0, there - dark(k + j)) * plan_.from_beyond(j);
      most_[at(k)] = std::min(most_[at(k)], dark(k) + plan_.climb(k, j) + lower);
    }
  }
  // Of a fall, what light from below leaves.
  const double own = demand[static_cast<std::size_t>(first)];
  double cap = free_above ? std::numeric_limits<double>::infinity() : own;
  double least_above = cap;
  for (int k = first; k <= end; ++k) {
    const auto falls = [&](double dose) {
      return dark(k) + std::max(0.0, dose - dark(k - 1)) / left(k - 1, 1);
    };
    if (k > first) least_above = falls(least_above);
    const int near = std::max(first, k - 2 * plan_.peak);
    least_above = std::min(least_above, wanted_most_[at(near)]);
    for (int i = near; i < k; ++i) most_[at(k)] = std::min(most_[at(k)], wanted_most_[at(i)]);
    most_[at(k)] = std::min(most_[at(k)], least_above);
    if (k > first + 2 * plan_.peak) cap = falls(cap);
    least_[at(k)] = std::min(least_[at(k)], cap);
    most_[at(k)] = std::min(most_[at(k)], cap);
  }
  for (int k = first; k <= end; ++k) {
    if ((k == first && !free_above) || (k == end && !free_below)) continue;
    double& wanted = demand[static_cast<std::size_t>(k)];
    const double dose = side_ == DoseSide::at_least  ? least_[at(k)]
                        : side_ == DoseSide::at_most ? most_[at(k)]
                                                     : (least_[at(k)] + most_[at(k)]) / 2;
    wanted = std::max(wanted, dose);
  }
}

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
  for (const int n : joints_) demand[static_cast<std::size_t>(n)] = demand_at(n);
  for (int n = 0; !wanted_.empty() && n < plan_.layers; ++n) {
    if (!full(n)) continue;
    int end = n + 1;
    while (full(end)) ++end;
    want_doses(n, end);
    n = end;
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
  for (std::size_t n = 0; n < left_alone_.size(); ++n) {
    if (left_alone_[n] == kNo) continue;
    coverage_[n] = kLeftAlone;
    left_alone_[n] = kYes;
  }
  take_joints();
  if (!plan_.merge_one_slice_gaps) return;
  for (int n = 1; n + 1 < plan_.layers; ++n) {
    if (coverage(n) == 0 && !left_alone(n) && full(n - 1) && full(n + 1)) {
      coverage_[static_cast<std::size_t>(n)] = 255;
    }
  }
}

/// Where a feature hangs on what is left alone, the last layer of that is to gel like the feature's own,
/// whose light alone can see to it.
void ColumnDesign::take_joints() {
  joints_.clear();
  for (int n = 0; static_cast<std::size_t>(n) < left_alone_.size(); ++n) {
    const bool ends = left_alone(n) && full(n + 1), held = n == 0 || left_alone(n - 1);
    if (!ends || !held) continue;
    const auto at = static_cast<std::size_t>(n);
    left_alone_[at] = kJoint;
    coverage_[at] = 255;
    if (at + 1 < wanted_.size()) wanted_[at] = wanted_[at + 1];
    joints_.push_back(n);
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
  // Between nodes the dose may dip by a little, also where the platform or what is left alone is to hold
  // the feature; edges get just what they need.
  const auto holds = [&](int layer) { return layer < 0 || full(layer) || left_alone(layer); };
  if ((above == 255 && holds(node)) || (below == 255 && holds(node - 1))) {
    return plan_.inside_of(std::max(node - 1, 0), std::min(node, plan_.layers - 1));
  }
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
    feature.platform = feature.upper == 0 || left_alone(feature.upper - 1);
    feature.lag = plan_.lags.front();
    features.push_back(feature);
  }
}

/// At a gap of one layer the edge of the feature above gives way, while the middle of that
/// feature's last layer still prints.
void ColumnDesign::open_one_slice_gaps() {
  for (int n = 1; n + 1 < plan_.layers; ++n) {
    if (coverage(n) != 0 || left_alone(n) || !full(n - 1) || !full(n + 1)) continue;
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
    // Neither the platform nor what is left alone is a gap: a feature has no edge there.
    const bool free_above = n == 0 || left_alone(n - 1);
    const int above = free_above ? -1 : coverage(n - 1), below = left_alone(n) ? -1 : coverage(n);
    if (above == 0 && below == 255) add(n, true);
    if (above == 255 && below == 0) add(n, false);
  }
  has_heights =
      std::any_of(edges.begin(), edges.end(), [](const Edge& edge) { return edge.aim != 0; });
}

}  // namespace slicecorr::detail
