// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "sim/exposures.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace slicecorr::bridge::detail {

namespace {

constexpr long kMostSlices = 1000000;

}  // namespace

void Exposures::begin(const SliceFacts& facts) {
  facts_ = facts;
  slices_.clear();
  last_ = nullptr;
}

double Exposures::edge_um(long slice) const {
  return facts_.start_um +
         (static_cast<double>(slice) + (facts_.layerwise ? 0.5 : 0.0)) * facts_.layer_um;
}

void Exposures::find(const Motion& stage) {
  last_ = nullptr;
  if (!recording()) return;
  slice_ = static_cast<long>(std::floor((stage.at_um - edge_um(0)) / facts_.layer_um));
  // On an edge it belongs to the slice that it moves into.
  if (stage.at_um == edge_um(slice_) && stage.speed_um_s < 0) --slice_;
}

double Exposures::until_edge(const Motion& stage, double acceleration) const {
  if (!recording()) return std::numeric_limits<double>::infinity();
  const double up = edge_um(slice_ + 1), down = edge_um(slice_);
  double time = std::numeric_limits<double>::infinity();
  // On the edge that it came over it only gets back by turning round.
  if (stage.at_um < up) time = std::min(time, time_to(stage, acceleration, up));
  if (stage.at_um > down) time = std::min(time, time_to(stage, acceleration, down));
  if (stage.at_um >= up && stage.speed_um_s > 0) time = 0;
  if (stage.at_um <= down && stage.speed_um_s < 0) time = 0;
  return time;
}

void Exposures::cross(const Motion& stage) {
  const double middle = (edge_um(slice_) + edge_um(slice_ + 1)) / 2;
  slice_ += stage.at_um > middle ? 1 : -1;
}

void Exposures::add(const Lit& lit) {
  if (!recording() || lit.time_s <= 0) return;
  const long slice = std::clamp(slice_, 0L, kMostSlices);
  const bool goes_on = last_ && last_slice_ == slice && last_->image == lit.image;
  if (!goes_on) {
    if (static_cast<std::size_t>(slice) >= slices_.size()) {
      slices_.resize(static_cast<std::size_t>(slice) + 1);
    }
    auto& showings = slices_[static_cast<std::size_t>(slice)].showings;
    SliceExposure::Showing showing;
    showing.image = lit.image;
    showing.from_um = lit.from_um - facts_.start_um;
    showings.push_back(showing);
    last_ = &showings.back();
    last_slice_ = slice;
    sums_ = {};
  }
  SliceExposure::Showing& p = *last_;
  p.light_s += lit.light_s;
  p.time_s += lit.time_s;
  sums_.blue_s += lit.blue_s;
  sums_.uv_s += lit.uv_s;
  p.to_um = lit.to_um - facts_.start_um;
  p.speed_um_s = (p.to_um - p.from_um) / p.time_s;
  p.blue_share = sums_.blue_s / p.time_s;
  p.uv_mw_cm2 = sums_.uv_s / p.time_s;
}

}  // namespace slicecorr::bridge::detail
