// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <algorithm>
#include <cmath>

#include "correct/tried_column.hpp"
#include "cure/margin.hpp"
#include "slicecorr/units.hpp"

namespace slicecorr::detail {

namespace {

/// Edges are aimed at no further from their nodes, in slices: beyond, the middle of a layer would give
/// way.
constexpr double kFarthest = 0.43;
/// The same where light may be off, and by how much more than 1 features are to have then.
constexpr double kFarthestOff = 0.2, kMarginOff = 0.01;
/// Edges that are off by less, um, are right.
constexpr double kRightUm = 0.05;
/// With so many levels or more the last three slices before an edge place it; with fewer, more.
constexpr int kManyLevels = 128;

}  // namespace

TriedPlan::TriedPlan(const CureModel& cure_model, const Process& process, int target_layers,
                     int all_slices)
    : model(cure_model),
      layerwise(model.mode == ExposureMode::layerwise),
      layers(target_layers),
      all_layers(all_slices),
      shortfall(std::min(process.gap_shortfall, kFarthest)) {
  const std::vector<double>& phi = model.level_phi;
  highest = static_cast<int>(phi.size()) - 1;
  while (highest > 0 && phi[static_cast<std::size_t>(highest) - 1] == phi.back()) --highest;
  burst = model.slices_to_gel() + 2;
  if (!model.heights.alike()) {
    // Of the thinnest layers it takes the most.
    double thinnest = 1;
    for (int n = 0; n < static_cast<int>(model.own_a.size()); ++n) {
      thinnest = std::min(thinnest, model.height(n));
    }
    burst = static_cast<int>(std::ceil(burst / thinnest)) + 2;
  }
  together = static_cast<int>(phi.size()) >= kManyLevels ? 3 : 5;
  // At the upper edge of a feature black light takes the dose down: with a time to gel by about half of
  // what light falls.
  const double fall =
      model.bleaching() ? model.bleaching()->absorbed(1.0) : 0.5 * model.eta * units::kLn10;
  edge_dose = std::max(kRightUm, process.edge_aim_um) * (fall / model.layer_um);
}

double TriedPlan::margin() const { return careful ? kMarginOff : kMargin; }
double TriedPlan::farthest() const { return careful ? kFarthestOff : kFarthest; }

ColumnFacts TriedPlan::facts() const {
  // Edges are placed to a part of this.
  constexpr double height_steps = 64;
  const auto levels = static_cast<int>(model.level_phi.size());
  return {layers, all_layers, layerwise, height_steps, 0, 0, solved, levels};
}

}  // namespace slicecorr::detail
