// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file layer_heights.hpp
/// Heights of layers that are not all alike (docs/print-files.md).
///
/// Plain values; const functions are thread-safe, nothing throws.
#pragma once

#include <algorithm>
#include <cstddef>
#include <utility>
#include <vector>

namespace slicecorr {

/// Height of each layer where they differ; the last holds for later layers. Empty: all are alike.
class LayerHeights {
 public:
  LayerHeights() = default;
  /// `um`: each above 0; empty: all are alike.
  explicit LayerHeights(std::vector<double> um) : um_(std::move(um)) {
    nodes_um_.push_back(0);
    for (const double height : um_) nodes_um_.push_back(nodes_um_.back() + height);
  }
  bool alike() const { return um_.empty(); }
  const std::vector<double>& um() const { return um_; }
  /// Height of a layer, um, where layers alike are `usual_um` high.
  double of(int layer, double usual_um) const {
    return um_.empty() ? usual_um : um_[at(layer, um_.size())];
  }
  /// Where a place is, um from the platform: `zeta` counts layers, its fraction a part of one.
  double place_um(double zeta, double usual_um) const {
    if (um_.empty()) return zeta * usual_um;
    const auto layer = static_cast<int>(std::max(0.0, zeta));
    const std::size_t last = um_.size() - 1, n = at(layer, um_.size());
    const double before =
        nodes_um_[n] + (static_cast<std::size_t>(std::max(0, layer)) - n) * um_[last];
    return before + (zeta - layer) * um_[n];
  }
  bool operator==(const LayerHeights& o) const { return um_ == o.um_; }

 private:
  static std::size_t at(int layer, std::size_t size) {
    return std::min(static_cast<std::size_t>(std::max(0, layer)), size - 1);
  }
  std::vector<double> um_, nodes_um_;  ///< nodes from the platform on
};

}  // namespace slicecorr
