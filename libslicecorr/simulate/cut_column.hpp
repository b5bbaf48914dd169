// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// A pixel column of a resin with a time to gel against time.
#pragma once

#include <algorithm>
#include <vector>

#include "cure/gel_time_cut.hpp"
#include "slicecorr/cure.hpp"
#include "slicecorr/simulate.hpp"

namespace slicecorr::detail {

/// Doses of a column up to a moment: as of a print that ends there.
class CutColumn {
 public:
  /// `light`: of each slice, with its exposure.
  CutColumn(const CureModel& model, std::vector<CutLight> light)
      : model_(model),
        cut_(*model.gel_time()),
        light_(std::move(light)),
        state_(light_.size() + 1) {}

  /// Sets the moment.
  void begin(const PrintClock::Moment& now) {
    const GelTimeKernel& kernel = *model_.gel_time();
    const auto n = static_cast<std::size_t>(now.slice);
    now_ = now;
    whole_ = light_[n];
    state_[n + 1] = {};
    if (kernel.layer_by_layer()) {
      light_[n] = {now.share * whole_.x, now.share * whole_.y};
    } else if (now.share < 1.0) {
      // A slice that is shown in part is one shown whole, less what is still to come.
      const CutLight rest = kernel.fade(now.share - 1.0);
      state_[n + 1] = {whole_.x * (1.0 - rest.x), whole_.y * (1.0 - rest.y)};
    }
    for (std::size_t p = n + 1; p-- > 0;) state_[p] = cut_.step(light_[p], state_[p + 1]);
  }
  /// After the last question of a moment.
  void end() { light_[static_cast<std::size_t>(now_.slice)] = whole_; }

  /// The part of layer k that has been in the light, slices from its upper node: 1 but for the last.
  double shown(int k) const { return moving() && k == now_.slice ? now_.share : 1.0; }
  /// The dose `up` slices above the lower end of what is shown of layer k.
  double at(int k, double up) {
    const auto i = static_cast<std::size_t>(k);
    if (moving() && k == now_.slice) {
      const Nothing below;
      return cut_.dose(light_[i], model_.gel_time()->fade(up), below, hint_);
    }
    const Below below{*this, k};
    return cut_.dose(light_[i], model_.gel_time()->fade(up), below, hint_);
  }

 private:
  struct Nothing {
    static int count() { return 1; }
    static double x(int) { return 0; }
    static double y(int) { return 0; }
    static CutLight light(int) { return {}; }
  };
  struct Below {
    const CutColumn& column;
    int layer;
    int count() const { return column.now_.slice + 1 - layer; }
    const CutLight& state(int j) const {
      return column.state_[static_cast<std::size_t>(layer + 1 + j)];
    }
    double x(int j) const { return state(j).x; }
    double y(int j) const { return state(j).y; }
    const CutLight& light(int j) const {
      return column.light_[static_cast<std::size_t>(layer + 1 + j)];
    }
  };
  bool moving() const { return model_.mode == ExposureMode::continuous; }

  const CureModel& model_;
  GelTimeCut cut_;
  std::vector<CutLight> light_, state_;
  PrintClock::Moment now_{0, 0};
  CutLight whole_;
  int hint_ = 0;
};

}  // namespace slicecorr::detail
