// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// The doses of a pixel column at a moment of its print, where they are not sums of what slices add: of
/// a resin with a time to gel, of one that bleaches, and of one that lifts exchange.
#pragma once

#include <algorithm>
#include <cmath>
#include <memory>
#include <utility>
#include <vector>

#include "cure/gel_time_cut.hpp"
#include "cure/steps.hpp"
#include "slicecorr/cure.hpp"
#include "slicecorr/simulate.hpp"
#include "slicecorr/units.hpp"

namespace slicecorr::detail {

/// Doses of a column up to a moment: as of a print that ends there.
class DosesInTime {
 public:
  explicit DosesInTime(const CureModel& model)
      : model_(model), moving_(model.mode == ExposureMode::continuous) {}
  virtual ~DosesInTime() = default;

  /// Sets the moment.
  void begin(const PrintClock::Moment& now) {
    now_ = now;
    set();
  }
  /// After the last question of a moment.
  virtual void end() = 0;
  /// The part of layer k that has been in the light, slices from its upper node: 1 but for the last.
  double shown(int k) const { return moving_ && k == now_.slice ? now_.share : 1.0; }
  /// The dose `up` slices above the lower end of what is shown of layer k.
  virtual double at(int k, double up) = 0;

 protected:
  virtual void set() = 0;

  const CureModel& model_;
  bool moving_;
  PrintClock::Moment now_{0, 0};
};

/// With a time to gel.
class CutColumn final : public DosesInTime {
 public:
  /// `light`: of each slice, with its exposure.
  CutColumn(const CureModel& model, std::vector<CutLight> light)
      : DosesInTime(model), cut_(model), light_(std::move(light)), state_(light_.size() + 1) {}

  void set() override {
    const GelTimeKernel& kernel = *model_.gel_time();
    const PrintClock::Moment& now = now_;
    const auto n = static_cast<std::size_t>(now.slice);
    whole_ = light_[n];
    state_[n + 1] = {};
    if (kernel.layer_by_layer()) {
      light_[n] = {now.share * whole_.x, now.share * whole_.y};
    } else if (now.share < 1.0) {
      // A slice that is shown in part is one shown whole, less what is still to come.
      const CutLight rest = kernel.fade(now.share - 1.0);
      state_[n + 1] = {whole_.x * (1.0 - rest.x), whole_.y * (1.0 - rest.y)};
    }
    for (std::size_t p = n + 1; p-- > 0;)
      state_[p] = cut_.step(light_[p], state_[p + 1], static_cast<int>(p));
  }
  void end() override { light_[static_cast<std::size_t>(now_.slice)] = whole_; }
  double at(int k, double up) override {
    const auto i = static_cast<std::size_t>(k);
    if (moving_ && k == now_.slice) {
      const Nothing below;
      // `up` counts from the window.
      const double window = k + now_.share;
      return cut_.dose(k, light_[i], model_.gel_time()->fade(up), below, hint_,
                       cut_.returned(window - up));
    }
    const Below below{*this, k};
    return cut_.dose(k, light_[i], model_.gel_time()->fade(up), below, hint_,
                     cut_.returned(k + 1 - up));
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
  GelTimeCut cut_;
  std::vector<CutLight> light_, state_;
  CutLight whole_;
  int hint_ = 0;
};

/// Of a resin that bleaches.
class BleachingColumn final : public DosesInTime {
 public:
  BleachingColumn(const CureModel& model, std::vector<double> phi)
      : DosesInTime(model), steps_(model), phi_(std::move(phi)), dose_(phi_.size() + 1) {}

  void set() override {
    const auto n = static_cast<std::size_t>(now_.slice);
    dose_[n + 1] = 0;
    for (std::size_t k = n + 1; k-- > 0;) {
      dose_[k] = at(static_cast<int>(k), shown(static_cast<int>(k)));
    }
  }
  void end() override {}
  double at(int k, double up) override {
    const auto i = static_cast<std::size_t>(k);
    if (moving_) return steps_.after(up, phi_[i], dose_[i + 1]);
    const double light = k == now_.slice ? now_.share * phi_[i] : phi_[i];
    return steps_.after(up, 0.0, light + dose_[i + 1]);
  }

 private:
  BleachingSteps steps_;
  std::vector<double> phi_, dose_;
};

/// Of a resin that lifts exchange: the greatest dose that a place has had, at each lift and now
/// (docs/lifts.md). Moments come in order, or all begins anew.
class ExchangedColumn final : public DosesInTime {
 public:
  ExchangedColumn(const CureModel& model, std::vector<double> phi)
      : DosesInTime(model), keeps_(1.0 - *model.lifts->exchange), phi_(std::move(phi)) {
    constexpr double nothing = 1e-18;
    const auto bath = static_cast<std::size_t>(model.bath_slices);
    const std::size_t most = bath > 0 ? std::min(bath, phi_.size()) : phi_.size();
    for (double f = 1; f > nothing && fade_.size() < most; f *= model.a) fade_.push_back(f);
    clear();
  }

  void set() override {
    if (now_.slice < done_) clear();
    for (; done_ < now_.slice; ++done_) {
      const auto n = static_cast<std::size_t>(done_);
      for (std::size_t j = 0; j < fade_.size() && j <= n; ++j) {
        Layer& layer = layers_[n - j];
        layer.dose = keeps_ * layer.dose + phi_[n] * fade_[j];
        layer.greatest = std::max(layer.greatest, layer.dose);
      }
    }
  }
  void end() override {}
  double at(int k, double up) override {
    const Layer& layer = layers_[static_cast<std::size_t>(k)];
    const auto j = static_cast<std::size_t>(now_.slice - k);
    const double light = phi_[static_cast<std::size_t>(now_.slice)] * now_.share;
    const double now = keeps_ * layer.dose + (j < fade_.size() ? light * fade_[j] : 0.0);
    return std::max(layer.greatest, now) * std::exp(-model_.eta * units::kLn10 * up) *
           model_.returned(k + 1 - up);
  }

 private:
  /// At its window, after the lifts so far.
  struct Layer {
    double dose = 0, greatest = 0;
  };
  void clear() {
    layers_.assign(phi_.size(), {});
    done_ = 0;
  }

  double keeps_;
  std::vector<double> phi_, fade_;  ///< `fade_`: a^j, as far as the resin is deep
  std::vector<Layer> layers_;
  int done_ = 0;  ///< slices that have been shown whole
};

/// Null where doses are sums of what slices add. `phi`: of each slice, with its exposure.
inline std::unique_ptr<DosesInTime> make_doses_in_time(const CureModel& model,
                                                       std::vector<double> phi) {
  if (model.bleaching()) return std::make_unique<BleachingColumn>(model, std::move(phi));
  if (model.lifts && model.lifts->exchange.value_or(0) > 0) {
    return std::make_unique<ExchangedColumn>(model, std::move(phi));
  }
  if (!model.gel_time()) return nullptr;
  std::vector<CutLight> lights;
  for (std::size_t n = 0; n < phi.size(); ++n) {
    const double ratio = model.ratio(static_cast<int>(n));
    const CutLight l = model.gel_time()->light_of_phi(phi[n] / ratio);
    lights.push_back(model.gel_time()->in_slice(static_cast<int>(n), l, ratio));
  }
  return std::make_unique<CutColumn>(model, std::move(lights));
}

}  // namespace slicecorr::detail
