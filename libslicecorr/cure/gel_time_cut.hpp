// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// The relative dose of resins with a time to gel at one place: where the light of the place is cut
/// between inhibitor and growth (gel_time.hpp).
///
/// `Nodes` says what lies below a layer, j nodes from its lower one: x(j) and y(j), the recursions
/// there (what all slices from that node on give, over A and B), and light(j), that of the slice
/// between nodes j and j + 1.
///
/// Resin that ends: of the light after the cut what comes from beyond its end is taken away, y of the
/// slices that the end has passed, so that the cut lies before it.
///
/// Layers of different heights fade light each by its own: what is said of nodes below a layer goes by how
/// far they are.
///
/// A platform that sends light back multiplies all light of a place by one factor (cure.hpp): X by it, Y
/// by its root.
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "slicecorr/cure.hpp"
#include "slicecorr/gel_time.hpp"

namespace slicecorr::detail {

/// What the walkers of a model share; immutable.
class GelTimeCut {
 public:
  explicit GelTimeCut(const CureModel& model) : GelTimeCut(*model.gel_time(), model) {}
  GelTimeCut(const GelTimeKernel& kernel, const CureModel& model)
      : model_(model),
        bath_(model.bath_slices),
        layerwise_(kernel.layer_by_layer()),
        reach_(std::max(kernel.reach(), model.bath_slices + 1)),
        kernel_(kernel) {
    double thinnest = 1;
    const int own = std::max(1, static_cast<int>(model.own_a.size()));
    for (int n = 0; n < own; ++n) {
      const double height = model.height(n);
      thinnest = std::min(thinnest, height);
      node_.push_back(kernel.fade(height));
      middle_.push_back(kernel.fade(0.5 * height));
    }
    reach_ = static_cast<int>(std::ceil(reach_ / thinnest));
    if (!model.heights.alike()) return;
    fade_.reserve(static_cast<std::size_t>(reach_) + 2);
    for (int j = 0; j <= reach_ + 1; ++j) fade_.push_back(kernel.fade(j));
  }

  int reach() const { return reach_; }
  /// The fade of the places whose doses are kept: a layer's upper node and its middle.
  const CutLight& node(int layer) const { return node_[own(layer)]; }
  const CutLight& middle(int layer) const { return middle_[own(layer)]; }
  /// Of a place a part of a layer from its lower node.
  CutLight fade(int layer, double up) const { return kernel_.fade(up * model_.height(layer)); }

  /// One node further up, through a layer: (A.32), layer by layer W(n).
  CutLight step(const CutLight& light, const CutLight& below, int layer) const {
    const CutLight& left = node(layer);
    if (layerwise_) return {(light.x + below.x) * left.x, (light.y + below.y) * left.y};
    return {light.x * (1.0 - left.x) + below.x * left.x,
            light.y * (1.0 - left.y) + below.y * left.y};
  }

  /// What light from the platform makes of X and Y at `zeta` slices from it.
  CutLight returned(double zeta) const {
    const double factor = model_.returned(zeta);
    return factor == 1.0 ? CutLight{1, 1} : CutLight{factor, std::sqrt(factor)};
  }
  bool ends() const { return bath_ > 0; }
  bool mirrors(int slice) const { return slice < model_.mirrored_slices; }

  /// The dose in layer `layer` of light `shown`, where `passed` remains of light that passes its lower node
  /// (`fade` of the distance from there). `nodes.count()`: nodes that are known, at least 1. `hint`:
  /// where the cut was found last, any number. `factors`: `returned` there.
  template <typename Nodes>
  double dose(int layer, const CutLight& shown, const CutLight& passed, const Nodes& nodes,
              int& hint, const CutLight& factors) const {
    const CutLight own{shown.x * factors.x, shown.y * factors.y};
    const CutLight left{passed.x * factors.x, passed.y * factors.y};
    const CutLight near = layerwise_ ? CutLight{own.x * passed.x, own.y * passed.y}
                                     : CutLight{own.x * (1.0 - passed.x), own.y * (1.0 - passed.y)};
    const double x0 = nodes.x(0);
    const double beyond = factors.y * passed_end(passed, nodes);
    const auto before = [&](int j) {
      return near.x + left.x * (x0 - far(layer, j).x * nodes.x(j));
    };
    const auto after = [&](int j) { return left.y * far(layer, j).y * nodes.y(j) - beyond; };
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
    if (j == 0) {
      return in_slice(0.0, after(0), own, passed.y, layerwise_ ? passed : CutLight{1, 1});
    }
    const CutLight light = nodes.light(j - 1);
    const CutLight its = far(layer, layerwise_ ? j : j - 1);
    return in_slice(before(j - 1), after(j), light, node(layer + j).y,
                    {left.x * its.x, left.y * its.y});
  }

 private:
  std::size_t own(int layer) const {
    return node_.size() == 1 ? 0 : std::min(model_.own(layer), node_.size() - 1);
  }
  /// What is left at a layer's lower node of light that passes the node so many nodes below it.
  CutLight far(int layer, int nodes) const {
    if (!fade_.empty()) return fade_[static_cast<std::size_t>(nodes)];
    return kernel_.fade(model_.depth(layer + 1 + nodes) - model_.depth(layer + 1));
  }
  /// y of what the end of the resin has passed, at a place as for `dose`.
  template <typename Nodes>
  double passed_end(const CutLight& passed, const Nodes& nodes) const {
    const int first = layerwise_ ? bath_ - 1 : bath_;
    if (bath_ == 0 || first >= nodes.count()) return 0;
    double y = passed.y * nodes.y(first);
    // The end lies in a slice, as far above its lower node as the place does in its layer.
    if (!layerwise_) y += (1.0 - passed.y) * nodes.light(bath_ - 1).y;
    return fade_[static_cast<std::size_t>(first)].y * std::max(0.0, y);
  }
  /// The dose where the light is cut in a slice: `x` lies before it and `y` after it; its own light is
  /// `faded` where it begins, and the root of it falls to `end` in it.
  double in_slice(double x, double y, const CutLight& light, double end,
                  const CutLight& faded) const {
    const double gx = light.x * faded.x, gy = light.y * faded.y;
    if (!(gx > 0)) return std::max(0.0, std::min(x, y));
    if (layerwise_) return x + gx * std::clamp((y + gy - x) / (gx + gy), 0.0, 1.0);
    // x + gx (1 - q²) = y + gy (q - end)
    const double c = std::max(0.0, x + gx - y + gy * end);
    const double q = 2.0 * c / (gy + std::sqrt(gy * gy + 4.0 * gx * c));
    return y + gy * (q - end);
  }

  const CureModel& model_;
  int bath_;
  bool layerwise_;
  int reach_;
  const GelTimeKernel& kernel_;
  std::vector<CutLight> node_, middle_;  ///< of each layer; of all where they are alike
  std::vector<CutLight> fade_;           ///< by nodes; empty where layers differ
};

}  // namespace slicecorr::detail
