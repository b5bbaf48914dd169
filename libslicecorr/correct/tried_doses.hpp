// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// The doses of a column whose levels are tried (tried_column.hpp), by each law.
#pragma once

#include <algorithm>
#include <cstddef>
#include <memory>
#include <variant>
#include <vector>

#include "correct/tried_column.hpp"
#include "cure/gel_time_cut.hpp"
#include "cure/steps.hpp"

namespace slicecorr::detail {

/// The doses of a column whose slices are set from the last to the first: what a law must say to have
/// its levels tried.
///
/// - `set(n, level)`: slice n shows it; those after it are set.
/// - `dose(layer, up)`: at a place so many slices above the lower node of a layer; `upper`, `middle`: there.

/// With a time to gel.
class GelTimeDoses {
 public:
  explicit GelTimeDoses(const TriedPlan& plan)
      : kernel_(std::get<WithGelTime>(plan.model.law).kernel),
        cut_(plan.model),
        model_(plan.model),
        all_(plan.all_layers),
        state_(static_cast<std::size_t>(std::max(all_, 0)) + 1),
        light_(state_.size()) {}

  void clear() { state_.back() = {}; }
  void set(int n, int level) {
    const auto at = static_cast<std::size_t>(n);
    const CutLight& l = kernel_->light(level);
    light_[at] = kernel_->in_slice(n, l, model_.ratio(n));
    state_[at] = cut_.step(light_[at], state_[at + 1], n);
  }
  double dose(int layer, double up) const { return at(layer, cut_.fade(layer, up), up); }
  double upper(int layer) const { return at(layer, cut_.node(layer), 1.0); }
  double middle(int layer) const { return at(layer, cut_.middle(layer), 0.5); }

 private:
  /// What lies below a layer.
  struct Below {
    const GelTimeDoses& doses;
    int layer;
    int count() const { return doses.all_ - layer; }
    const CutLight& at(int j) const {
      return doses.state_[static_cast<std::size_t>(layer + 1 + j)];
    }
    double x(int j) const { return at(j).x; }
    double y(int j) const { return at(j).y; }
    const CutLight& light(int j) const {
      return doses.light_[static_cast<std::size_t>(layer + 1 + j)];
    }
  };
  double at(int layer, const CutLight& left, double up) const {
    return cut_.dose(layer, light_[static_cast<std::size_t>(layer)], left, Below{*this, layer},
                     hint_, cut_.returned(layer + 1 - up));
  }

  std::shared_ptr<const GelTimeKernel> kernel_;
  GelTimeCut cut_;
  const CureModel& model_;
  int all_;
  std::vector<CutLight> state_, light_;
  mutable int hint_ = 0;
};

/// Where the dose further up follows from the one below.
template <typename Steps>
class SteppedDoses {
 public:
  explicit SteppedDoses(const TriedPlan& plan)
      : steps_(plan.model),
        model_(plan.model),
        layerwise_(plan.layerwise),
        dose_(static_cast<std::size_t>(std::max(plan.all_layers, 0)) + 1),
        light_(dose_.size()) {}

  void clear() { dose_.back() = 0; }
  void set(int n, int level) {
    const auto at = static_cast<std::size_t>(n);
    light_[at] = model_.ratio(n) * model_.level_phi[static_cast<std::size_t>(level)];
    steps_.enter(n);
    dose_[at] = layerwise_ ? steps_.faded(light_[at] + dose_[at + 1])
                           : steps_.node(light_[at], dose_[at + 1]);
  }
  double dose(int layer, double up) const {
    steps_.enter(layer);
    return after(layer, steps_.part(up));
  }
  double upper(int layer) const { return dose_[static_cast<std::size_t>(layer)]; }
  double middle(int layer) const {
    const auto at = static_cast<std::size_t>(layer);
    steps_.enter(layer);
    return layerwise_ ? steps_.faded_half(light_[at] + dose_[at + 1])
                      : steps_.middle(light_[at], dose_[at + 1]);
  }

 private:
  double after(int layer, const typename Steps::Part& part) const {
    const auto at = static_cast<std::size_t>(layer);
    return layerwise_ ? steps_.after(part, 0.0, light_[at] + dose_[at + 1])
                      : steps_.after(part, light_[at], dose_[at + 1]);
  }

  mutable Steps steps_;  ///< in the layer at hand
  const CureModel& model_;
  bool layerwise_;
  std::vector<double> dose_, light_;  ///< at each node, of each slice
};

}  // namespace slicecorr::detail
