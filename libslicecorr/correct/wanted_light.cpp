// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "correct/wanted_light.hpp"

#include <algorithm>

#include "correct/coverage.hpp"

namespace slicecorr::detail {

WantedLight::WantedLight(const CorrectionPlan& plan, WalkSearches& searches)
    : model_(plan.model),
      searches_(searches),
      least_(static_cast<std::size_t>(std::max(plan.all_layers, 0)) + 1),
      most_(least_.size()),
      aim_most_(least_.size()),
      scaled_(least_.size()) {}

void WantedLight::begin(const ColumnBounds& bounds) {
  bounds_ = &bounds;
  over_ = under_ = 0;
}

DoseRange WantedLight::between(std::size_t search, int slice) const {
  const ContinuousPlan& p = plan_of(search);
  const double above = wanted(slice - 1) * scale_at(search, slice - 0.5);
  const double below = wanted(slice) * scale_at(search, slice + 0.5);
  const double middle = (above + below) / 2;
  const LayerFactors& layer = p.of(slice);
  const double ratio = p.ratio(slice);
  const bool steep =
      above > layer.step(ratio * p.phi_max, below) || above < layer.step(ratio * p.phi_min, below);
  return steep ? DoseRange{std::min(above, below), std::max(above, below)}
               : DoseRange{middle, middle};
}

void WantedLight::bound(ColumnWalk& walk, int lower) {
  const int node = walk.last().node;
  const std::size_t search = searches_.plans().at(node);
  const ContinuousPlan& p = plan_of(search);
  const Edges& edges = searches_.of(search).edges;
  const Edge& edge = edges[walk.edge_of(searches_, search)];
  double least_above = 0, most_above = 0;
  for (int k = node; k < lower; ++k) {
    const DoseRange fits = edges.doses(edge, k - node, 0);
    double least = fits.lo, most = fits.hi;
    if (k > node || walk.free_above()) {
      const double own = wanted(k) * scale_at(search, k);
      const DoseRange dose = k == node ? DoseRange{own, own} : between(search, k);
      least = dose.hi;
      most = dose.lo;
      if (k > node) {
        const LayerFactors& layer = p.of(k - 1);
        const double ratio = p.ratio(k - 1);
        least = std::max(least, (least_above - ratio * p.climb_max * layer.b) * layer.per_a);
        most = std::min(most, (most_above - ratio * p.phi_min * layer.b) * layer.per_a);
      }
      least = std::clamp(least, fits.lo, std::max(fits.lo, fits.hi));
      most = std::clamp(most, fits.lo, std::max(fits.lo, fits.hi));
    }
    least_above = least;
    most_above = most;
    const auto at = static_cast<std::size_t>(k);
    const double scale = scale_at(search, k);
    least_[at] = least / scale;
    most_[at] = most / scale;
    aim_most_[at] = bounds_->side == DoseSide::at_least  ? least_[at]
                    : bounds_->side == DoseSide::at_most ? most_[at]
                                                         : (least_[at] + most_[at]) / 2;
  }
}

LevelSearch::Wanted WantedLight::light_at(const WalkAsk& ask, int n) {
  const std::size_t search = ask.search;
  const ContinuousPlan& p = plan_of(search);
  const double omega = ask.below, taken = ask.taken ? ask.taken[0] : 0.0;
  const double room = bounds_->side == DoseSide::at_most ? 0.0 : p.feature_reserve;
  const double ratio = p.ratio(n);
  // Nodes that a search looks at; those of other runs have other factors, and count as this one's.
  const double* most = aim_most_.data();
  if (p.mirrored) {
    for (int k = n; k >= 0 && k > n - LevelSearch::kMost; --k) {
      const auto at = static_cast<std::size_t>(k);
      scaled_[at] = aim_most_[at] * scale_at(search, k);
    }
    most = scaled_.data();
  }
  LevelSearch::Wanted want{ratio * p.phi_max, bounds_->side, most, room};
  if (searches_.of(search).edges[ask.run.edge].below != kFull) return want;
  const auto at = static_cast<std::size_t>(n);
  if (n + 1 == ask.run.lower) over_ = under_ = omega;
  const LayerFactors& layer = p.of(n);
  const auto reached = [&](double dose, double from) {
    return std::clamp(dose, layer.step(ratio * p.phi_min - taken, from),
                      layer.step(ratio * p.phi_max - taken, from));
  };
  const double least = least_[at] * scale_at(search, n);
  const double most_here = most_[at] * scale_at(search, n);
  over_ = reached(least, over_);
  under_ = reached(most_here, under_);
  // The light with which the middle of the layer has its dose.
  const double aim = wanted(n) * scale_at(search, n + 0.5);
  const double middle = (aim - layer.root_a * omega) / (1.0 - layer.root_a);
  const bool inner = n + 1 < ask.run.lower;
  const double below = scale_at(search, n + 1);
  const auto to_node = [&](double dose) { return (dose - layer.a * omega) * layer.per_b; };
  switch (bounds_->side) {
    case DoseSide::nearest:
      want.phi = to_node((over_ + under_) / 2);
      break;
    case DoseSide::at_least:
      want.phi = to_node(least);
      if (inner && omega >= least_[at + 1] * below) want.phi = std::max(want.phi, middle);
      break;
    case DoseSide::at_most:
      want.phi = to_node(most_here);
      if (inner && omega <= most_[at + 1] * below) want.phi = std::min(want.phi, middle);
      break;
  }
  want.phi += taken;
  return want;
}

}  // namespace slicecorr::detail
