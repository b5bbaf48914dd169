// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What one column asks for under inhibiting UV light.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "correct/inhibited_plan.hpp"

namespace slicecorr::detail {

/// Layer n lies between node n, nearer to the platform, and node n + 1. For one thread.
class ColumnDesign {
 public:
  explicit ColumnDesign(const InhibitedPlan& plan);
  /// What is left alone, and which doses are wanted, of the columns that are read from now on.
  void ask(const ColumnBounds& bounds);
  /// `runs`: what is covered, first layer first. `farthest`: how far from its node an edge is aimed,
  /// in layers.
  void read(const std::vector<CoverageRun>& runs, double farthest = 0);

  /// Covered layers that follow each other: nodes upper .. lower have demands.
  struct Feature {
    int upper = 0, lower = 0;
    bool platform = false;  ///< begins at the platform, or at what is left alone
    bool full = true;       ///< all of its demands are those of full layers
    int lag = 1;            ///< slices; see inhibited_column.hpp
    bool operator==(const Feature&) const = default;
  };
  /// Where full layers and a gap meet: a node, whether the gap is on the platform's side of it, and
  /// how far below the node the edge belongs, and is aimed at, in slices (target.hpp).
  struct Edge {
    int node;
    bool upper;
    double below = 0, aim = 0;
  };
  /// Coverage of a layer, 0..255; 0 outside of the target and of what is left alone.
  int coverage(int layer) const {
    const bool inside = layer >= 0 && layer < plan_.layers && !left_alone(layer);
    return inside ? coverage_[static_cast<std::size_t>(layer)] : 0;
  }
  bool left_alone(int layer) const {
    return layer >= 0 && static_cast<std::size_t>(layer) < left_alone_.size() &&
           left_alone_[static_cast<std::size_t>(layer)] == kYes;
  }
  /// The same of layers from `first` on, 0 <= first <= the plan's slices; of what is left alone a grey.
  const std::uint8_t* coverage_from(int first) const { return coverage_.data() + first; }
  bool full(int layer) const { return coverage(layer) == 255; }

  std::vector<double> demand;  ///< relative dose, per node; 0: none
  std::vector<Feature> features;
  std::vector<Edge> edges;
  int last_node = 0;         ///< highest node with a demand
  bool has_heights = false;  ///< an edge is aimed at beside its node
  /// Whether nodes deep inside features demand different doses.
  bool varies() const { return !wanted_.empty(); }

 private:
  void take_coverage(const std::vector<CoverageRun>& runs);
  void take_joints();
  void take_heights(const std::vector<CoverageRun>& runs);
  double below_node(int node, double farthest) const;
  double demand_at(int node) const;
  void want_doses(int first, int end);
  void find_features();
  void open_one_slice_gaps();
  void find_edges();

  const InhibitedPlan& plan_;
  double farthest_ = 0;
  std::vector<std::uint8_t> coverage_;  ///< per layer
  std::vector<std::uint8_t> heights_;   ///< edge heights per node
  /// `kJoint`: left alone, and what a feature hangs on, of which it asks as of its own layers.
  enum LeftAloneLayer : std::uint8_t { kNo, kYes, kJoint };
  std::vector<LeftAloneLayer> left_alone_;  ///< per layer; empty: none
  std::vector<int> joints_;                 ///< layers of what is left alone that features hang on
  std::vector<double> wanted_;              ///< per layer; empty: just enough
  DoseSide side_ = DoseSide::nearest;
  std::vector<double> least_, most_, wanted_most_;  ///< of a feature, by its nodes
};

}  // namespace slicecorr::detail
