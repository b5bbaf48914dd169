// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// The relative dose of resins with a time to gel at one place: where the light of the place is cut
/// between inhibitor and growth (gel_time.hpp).
///
/// `Nodes` says what lies below a layer, j nodes from its lower one: x(j) and y(j), the recursions
/// there (what all slices from that node on give, over A and B), and light(j), that of the slice
/// between nodes j and j + 1.
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "slicecorr/gel_time.hpp"

namespace slicecorr::detail {

/// What the walkers of a model share; immutable.
class GelTimeCut {
 public:
  explicit GelTimeCut(const GelTimeKernel& kernel)
      : layerwise_(kernel.layer_by_layer()),
        reach_(kernel.reach()),
        node_(kernel.fade(1.0)),
        middle_(kernel.fade(0.5)) {
    fade_.reserve(static_cast<std::size_t>(reach_) + 2);
    for (int j = 0; j <= reach_ + 1; ++j) fade_.push_back(kernel.fade(j));
  }

  int reach() const { return reach_; }
  /// The fade of the places whose doses are kept: a layer's upper node and its middle.
  const CutLight& node() const { return node_; }
  const CutLight& middle() const { return middle_; }

  /// One node further up: (A.32), layer by layer W(n).
  CutLight step(const CutLight& light, const CutLight& below) const {
    if (layerwise_) return {(light.x + below.x) * node_.x, (light.y + below.y) * node_.y};
    return {light.x * (1.0 - node_.x) + below.x * node_.x,
            light.y * (1.0 - node_.y) + below.y * node_.y};
  }

  /// The dose in a layer of light `own`, where `left` remains of light that passes its lower node
  /// (`fade` of the distance from there). `nodes.count()`: nodes that are known, at least 1. `hint`:
  /// where the cut was found last, any number.
  template <typename Nodes>
  double dose(const CutLight& own, const CutLight& left, const Nodes& nodes, int& hint) const {
    const CutLight near = layerwise_ ? CutLight{own.x * left.x, own.y * left.y}
                                     : CutLight{own.x * (1.0 - left.x), own.y * (1.0 - left.y)};
    const double x0 = nodes.x(0);
    const auto before = [&](int j) {
      return near.x + left.x * (x0 - fade_[static_cast<std::size_t>(j)].x * nodes.x(j));
    };
    const auto after = [&](int j) {
      return left.y * fade_[static_cast<std::size_t>(j)].y * nodes.y(j);
    };
    const int last = std::min(reach_, nodes.count() - 1);
    int j = std::clamp(hint, 0, last);
    if (before(j) >= after(j)) {
      while (j > 0 && before(j - 1) >= after(j - 1)) --j;
    } else {
      do ++j;
      while (j <= last && before(j) < after(j));
    }
    hint = j;
    // Further away than anything counts.
    if (j > last) return before(last);
    if (j == 0) return in_slice(0.0, after(0), own, left.y, layerwise_ ? left : CutLight{1, 1});
    const CutLight light = nodes.light(j - 1);
    const CutLight& far = fade_[static_cast<std::size_t>(layerwise_ ? j : j - 1)];
    return in_slice(before(j - 1), after(j), light, node_.y, {left.x * far.x, left.y * far.y});
  }

 private:
  /// The dose where the light is cut in a slice: `x` lies before it and `y` after it; its own light is
  /// `faded` where it begins, and the root of it falls to `end` in it.
  double in_slice(double x, double y, const CutLight& light, double end,
                  const CutLight& faded) const {
    const double gx = light.x * faded.x, gy = light.y * faded.y;
    if (!(gx > 0)) return std::min(x, y);
    if (layerwise_) return x + gx * std::clamp((y + gy - x) / (gx + gy), 0.0, 1.0);
    // x + gx (1 - q²) = y + gy (q - end)
    const double c = std::max(0.0, x + gx - y + gy * end);
    const double q = 2.0 * c / (gy + std::sqrt(gy * gy + 4.0 * gx * c));
    return y + gy * (q - end);
  }

  bool layerwise_;
  int reach_;
  CutLight node_, middle_;
  std::vector<CutLight> fade_;  ///< by nodes
};

}  // namespace slicecorr::detail
