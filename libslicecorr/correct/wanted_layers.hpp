// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Levels of features of which doses are wanted, layer by layer, in the middles of layers
/// (docs/graded-dose.md).
#pragma once

#include <cstddef>
#include <vector>

#include "correct/layer_level.hpp"
#include "correct/layer_walk.hpp"
#include "correct/lifted_feature.hpp"

namespace slicecorr::detail {

/// For one thread.
class WantedLayers {
 public:
  /// `lifted`: null without lifts. Both outlive it.
  WantedLayers(const CorrectionPlan& plan, const LiftedFeature* lifted);

  /// The next feature, before its last slice. `bounds.wanted`: of all layers.
  void begin(const LayerRun& run, const ColumnBounds& bounds, const LayerWalk& walk);
  /// The level of its slice n; slices from the last on.
  int level(int n, const LayerWalk& walk);

 private:
  /// Levels of the layers that make an edge above a gap, with lifts, and whether they may be lower.
  struct EdgeLevels {
    std::vector<Level> highest, lowest;
  };

  double phi(int level) const { return plan_.levels.phi(level); }
  double ratio(int n) const { return plan_.model.ratio(n); }
  double a(int n) const { return plan_.model.a_of(n); }
  double one_minus_a(int n) const { return plan_.model.one_minus_a_of(n); }
  /// What full light counts for at least, where the bath ends.
  double full(int n) const { return plan_.model.steady(phi(plan_.levels.highest())) * ratio(n); }
  /// By how much light from the platform multiplies doses at `zeta` layers from it.
  double returned(double zeta) const { return plan_.model.returned(zeta); }
  /// Dose at the window of a layer whose far end gels.
  double gels_through(int n) const;
  /// The least light of a layer that holds at its lift, at its own exposure; without lifts black.
  double held(int n) const;
  void bound(const ColumnBounds& bounds);
  EdgeLevels edge_levels(double after) const;
  /// The first layers of the feature, up to layer n.
  LiftedFeature::Ask edge_ask(int n, double after) const;
  int level_inside(int n, int lowest, int highest, const LayerWalk& walk);
  int lifted_level(int n, const LayerWalk& walk);

  const CorrectionPlan& plan_;
  const LiftedFeature* lifted_;
  /// Doses at windows: below `least_` some layer above gets too little, above `most_` too much.
  std::vector<double> least_, most_;
  std::vector<double> cap_;  ///< without lifts: beyond it the edge above is passed
  /// Dose at a window where it and all slices after it show full light, or the least that holds.
  std::vector<double> brightest_, darkest_;
  LayerRun run_;  ///< the feature at hand
  EdgeLevels edge_;
  DoseSide side_ = DoseSide::nearest;
  double over_ = 0, under_ = 0;  ///< doses at windows that are never too low, and never too high
};

}  // namespace slicecorr::detail
