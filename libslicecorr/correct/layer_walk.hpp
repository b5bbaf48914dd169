// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// One column layer by layer: its runs, and what slices leave behind.
///
/// A slice adds to its own layer alone what later slices do not bring, and the dose falls by a to the next
/// layer up: y_n = phi_n + a y_(n+1) at the window of layer n, sqrt(a) y_n in its middle. Layers of
/// different heights have an a of their own each: that of the layer which light passes.
#pragma once

#include <algorithm>
#include <cstdint>
#include <vector>

#include "correct/column_solver.hpp"
#include "correct/coverage.hpp"
#include "slicecorr/cure.hpp"

namespace slicecorr::detail {

/// Layers [first, end) of a column, of one coverage or left alone.
struct LayerRun {
  int first = 0, end = 0;
  int lit_from = 0;  ///< where what is lit without a gap up to it begins
  std::uint8_t coverage = 0;
  std::uint8_t height = 0;  ///< edge height of its upper node, below a gap or the platform; else 0
  bool gap_above = false;
  bool free_above =
      false;  ///< what lies above it asks nothing: the platform, or what is left alone
  bool left_alone = false;
  Level level = 0;  ///< left alone: what is shown

  bool is_feature() const { return coverage == kFull; }
  /// As if what is lit up to it were a feature with it.
  LayerRun as_feature() const {
    LayerRun feature = *this;
    feature.first = lit_from;
    feature.coverage = kFull;
    if (lit_from != first) feature.height = 0;
    return feature;
  }
};

/// The runs of a column, from the platform on.
inline void read_layer_runs(const std::vector<CoverageRun>& covered,
                            const std::vector<LeftAloneRun>& left_alone, int slices,
                            std::vector<LayerRun>& out) {
  out.clear();
  for_each_run(covered, left_alone, slices, [&](const CoverageRun& run, const LeftAloneRun* left) {
    LayerRun here;
    here.first = run.first;
    here.end = run.end;
    here.coverage = run.coverage;
    const bool goes_on = !out.empty() && out.back().coverage != 0 && !out.back().left_alone;
    here.lit_from = goes_on ? out.back().lit_from : run.first;
    here.free_above = out.empty() || out.back().left_alone;
    here.gap_above = !here.free_above && out.back().coverage == 0;
    here.height = out.empty() || here.gap_above ? run.upper_height : std::uint8_t{0};
    here.left_alone = left != nullptr;
    here.level = left ? left->level : Level{0};
    out.push_back(here);
  });
}

/// What slices leave at the window of the layer before them; from the last slice on.
class LayerWalk {
 public:
  explicit LayerWalk(const CureModel& model)
      : model_(model), exchanged_(model.lifts && model.lifts->exchange.value_or(0) > 0) {}

  void begin() { after_ = taken_ = 0; }
  /// To slice n, the next one. `light(k)`: phi of slice k, one that was passed, for what it counts.
  template <typename Light>
  void enter(int n, int slices, Light light) {
    taken_ = 0;
    const int leaves = n + model_.bath_slices;
    // Where lifts exchange resin the brightest slice counts alone.
    if (model_.bath_slices == 0 || exchanged_ || leaves >= slices) return;
    taken_ = model_.beyond * light(leaves);
    after_ -= taken_;
  }
  /// Takes the light of slice n, for what it counts. Where lifts exchange resin what is left is no less
  /// than that of the brightest slice, which is taken: no feature gets thinner by it.
  void pass(int n, double light) {
    const double a = model_.a_of(n);
    if (!exchanged_) {
      after_ = (light + after_) * a;
    } else if (model_.bath_slices > 0) {
      // In resin that ends the brightest may have left it.
      after_ = light * a;
    } else {
      after_ = std::max(light, after_) * a;
    }
  }
  /// The dose that later slices leave at the window of the layer at hand.
  double after() const { return after_; }
  /// What was taken from it because it leaves the bath.
  double taken() const { return taken_; }

 private:
  const CureModel& model_;
  bool exchanged_;
  double after_ = 0, taken_ = 0;
};

}  // namespace slicecorr::detail
