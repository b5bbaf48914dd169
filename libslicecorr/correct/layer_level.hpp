// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Layer by layer, without lifts: the level of one layer from the dose that later slices leave at its
/// window (docs/layerwise.md).
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "correct/layer_walk.hpp"
#include "slicecorr/correct.hpp"
#include "slicecorr/target.hpp"

namespace slicecorr::detail {

/// Light at a layer's window, and what becomes of it at the layer's far edge, its upper node.
struct LayerLight {
  const CorrectionPlan& plan;
  double ratio;
  double far_edge;          ///< W(n + 1), the dose that later slices leave at its window
  double dark;              ///< that of a black slice, at the window of the layer above
  std::uint8_t height = 0;  ///< edge height of the upper node where a gap lies above it, else 0
  int slice = 0;

  /// What light from the platform makes of doses at a distance below the layer's upper node.
  double returned(double below) const { return plan.model.returned(slice + below); }
  /// Computed just as BandDose does, to the last bit.
  double near(int level) const { return plan.levels.phi(level) * ratio + far_edge; }
  double phi(double at_window) const { return (at_window - far_edge) / ratio; }
  bool ends_at_node() const { return height == 0 || height == kEdgeAtNode; }
  /// Dose at the window that ends the print where the height says.
  double wanted() const {
    const double below = ends_at_node() ? 0.0 : edge_height_slices(height);
    const double a = plan.model.a_of(slice), at_node = std::pow(a, below) / returned(below);
    return (below < 0 ? std::max(1.0 / returned(0), at_node - dark) : at_node) / a;
  }
};

/// Dose of a black slice at its window; 0 for that of the platform's far side.
inline double dark_window(const CorrectionPlan& plan, int n) {
  return n < 0 ? 0.0 : plan.levels.phi(0) * plan.model.ratio(n);
}

/// What layer n of a run has. `after`: dose that later slices leave at its window.
inline LayerLight light_of_layer(const CorrectionPlan& plan, const LayerRun& run, int n,
                                 double after) {
  const std::uint8_t height = n == run.first ? run.height : std::uint8_t{0};
  return {plan, plan.model.ratio(n), after, dark_window(plan, n - 1), height, n};
}

/// How far below its upper node the edge of a run belongs, slices.
inline double edge_below(const LayerRun& run) {
  return run.height == 0 ? 0.0 : edge_height_slices(run.height);
}

/// The lowest level whose dose at the layer's upper node reaches `edge`.
int level_to_node(const LayerLight& light, double edge);

/// The grey level of a layer. For a full layer the level that brings its far edge where it belongs;
/// for a grey one the level whose dose in the middle is nearest to the coverage, but below 1. Where
/// no level does so, the one that comes nearest.
int layer_level(const LayerLight& light, std::uint8_t coverage);

}  // namespace slicecorr::detail
