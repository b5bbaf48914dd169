// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "correct/lifted_feature.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "cure/margin.hpp"
#include "slicecorr/units.hpp"

namespace slicecorr::detail {

namespace {

/// Of a dose of 1: less than this counts for nothing.
constexpr double kNothing = 1e-9;
constexpr double kMostReach = 1e6;

/// Whether edges are put where they belong, at the cost of layers that stay liquid on purpose.
bool places_edge(const LiftModel& lifts) { return lifts.exchange && !lifts.each_holds; }

}  // namespace

LiftedFeature::LiftedFeature(const CureModel& model, const LevelTable* levels,
                             std::optional<double> most_exchange)
    : model_(model), levels_(levels), most_exchange_(most_exchange) {
  double thinnest = 1;
  for (std::size_t n = 0; n < model.own_a.size(); ++n) {
    thinnest = std::min(thinnest, model.height(static_cast<int>(n)));
  }
  const double fall = thinnest * model.eta * units::kLn10;
  const double most = model.phi_max() * model.greatest_ratio() /
                      (model.heights.alike() ? model.one_minus_a : -std::expm1(-fall));
  const double slices = std::log(std::max(1.0, most) / kNothing) / fall;
  reach_ = static_cast<int>(std::min(kMostReach, std::ceil(slices)));
  // What a slice shows beyond the end of the resin does nothing at the node.
  if (model.bath_slices > 0) reach_ = std::min(reach_, model.bath_slices);
}

double LiftedFeature::least(double phi) const {
  if (!levels_) return std::clamp(phi, model_.phi_min(), model_.phi_max());
  return levels_->phi(levels_->at_least(phi));
}

double LiftedFeature::most(double phi) const {
  if (!levels_) return std::clamp(phi, model_.phi_min(), model_.phi_max());
  return levels_->phi(levels_->at_most(phi));
}

double LiftedFeature::own(int n, double dose, double up) const {
  return dose * std::exp(up * model_.height(n) * model_.eta * units::kLn10) /
         (model_.ratio(n) * model_.returned(n + 1 - up));
}

std::vector<double> LiftedFeature::floors(const Ask& ask, int liquid) const {
  const LiftModel& lifts = *model_.lifts;
  std::vector<double> phi(static_cast<std::size_t>(ask.layers));
  const double keeps = 1 + kMargin;
  for (int j = 0; j < ask.layers; ++j) {
    const int n = ask.node + j;
    double& light = phi[static_cast<std::size_t>(j)];
    if (j < liquid) {
      light = model_.phi_min();
    } else if (j > liquid) {
      light = least(own(n, lifts.green_strength * keeps, 1.0));
    } else if (places_edge(lifts)) {
      light = least(own(n, keeps, lifts.skin));
    } else {
      // What lies below the edge holds.
      light =
          least(own(n, lifts.green_strength * keeps, 1.0 - std::min(ask.below, 1 - lifts.skin)));
    }
  }
  return phi;
}

double LiftedFeature::peak(const Ask& ask, const std::vector<double>& phi, double exchange) const {
  double dose = 0, most_dose = 0, left = model_.a_of(ask.node);
  for (int j = 0; j < ask.layers; ++j, left *= model_.a_of(ask.node + j)) {
    dose = (1 - exchange) * dose +
           left * phi[static_cast<std::size_t>(j)] * model_.ratio(ask.node + j);
    most_dose = std::max(most_dose, dose);
  }
  const double after = ask.after * left / model_.a_of(ask.node + ask.layers);
  return std::max(most_dose, (1 - exchange) * dose + after);
}

void LiftedFeature::brighten(const Ask& ask, double most_dose, double exchange,
                             Light& light) const {
  std::vector<double>& phi = light.phi;
  const auto layers = static_cast<std::size_t>(ask.layers);
  // What each exposure leaves at the node, and D_j, by the least light.
  std::vector<double> dose(layers), left(layers);
  for (std::size_t j = 0; j < layers; ++j) {
    left[j] = (j == 0 ? 1.0 : left[j - 1]) * model_.a_of(ask.node + static_cast<int>(j));
    dose[j] = (j == 0 ? 0.0 : (1 - exchange) * dose[j - 1]) +
              left[j] * phi[j] * model_.ratio(ask.node + static_cast<int>(j));
  }
  double room = most_dose - ((1 - exchange) * dose.back() + ask.after * left.back());
  for (std::size_t j = layers; j-- > 0;) {
    // More light here adds to all D after it, by less and less.
    const double later =
        exchange < 1 ? room / (1 - exchange) : std::numeric_limits<double>::infinity();
    room = std::min(most_dose - dose[j], later);
    if (!(room > 0)) continue;
    const double counts = left[j] * model_.ratio(ask.node + static_cast<int>(j));
    // What stays liquid on purpose must not get a skin that is no film.
    const double ratio = model_.ratio(ask.node + static_cast<int>(j));
    const double liquid =
        (1 - kMargin) / (ratio * model_.returned(ask.node + static_cast<int>(j) + 1));
    const double room_for = phi[j] + room / counts;
    const bool stays = static_cast<int>(j) < light.liquid;
    const double more = std::max(phi[j], most(stays ? std::min(room_for, liquid) : room_for));
    room -= (more - phi[j]) * counts;
    phi[j] = more;
  }
}

std::vector<double> LiftedFeature::least_light(const Ask& ask) const {
  return places_edge(*model_.lifts) ? std::vector<double>{} : floors(ask, 0);
}

bool LiftedFeature::lift_to(const Ask& ask, double least_dose, double exchange,
                            Light& light) const {
  if (peak(ask, light.phi, exchange) >= least_dose * (1 - kMargin)) return true;
  double nearest = std::numeric_limits<double>::infinity(), raised = 0;
  std::size_t at = 0;
  for (auto j = static_cast<std::size_t>(light.liquid); j < light.phi.size(); ++j) {
    const double before = light.phi[j];
    const double more = least(std::nextafter(before, std::numeric_limits<double>::infinity()));
    light.phi[j] = more;
    const double dose = peak(ask, light.phi, exchange);
    if (dose >= least_dose * (1 - kMargin) && dose < nearest) {
      nearest = dose;
      raised = more;
      at = j;
    }
    light.phi[j] = before;
  }
  if (std::isinf(nearest)) return false;
  light.phi[at] = raised;
  return true;
}

LiftedFeature::Light LiftedFeature::solve(const Ask& ask) const {
  const LiftModel& lifts = *model_.lifts;
  if (model_.bath_slices > 0 && ask.after > 0) {
    // Where the resin ends not all of this reaches the node: no feature gets thinner for what does not.
    Ask without = ask;
    without.after = 0;
    return solve(without);
  }
  Light light;
  if (!places_edge(lifts)) {
    light.phi = floors(ask, 0);
    const double moved = std::exp(kLiftToleranceUm / model_.layer_um * model_.eta * units::kLn10);
    brighten(ask, peak(ask, light.phi, 0) * moved, 0, light);
    return light;
  }
  const double x = most_exchange_.value_or(*lifts.exchange);
  const double most_dose =
      std::exp(-ask.below * model_.eta * units::kLn10) / model_.returned(ask.node);
  for (int liquid = 0; liquid < ask.layers; ++liquid) {
    light.phi = floors(ask, liquid);
    light.liquid = liquid;
    if (peak(ask, light.phi, x) <= most_dose * (1 + 1e-6)) break;
  }
  brighten(ask, most_dose * (1 + kMargin), x, light);
  if (!most_exchange_ || lift_to(ask, most_dose, x, light) || light.liquid == 0) return light;
  // One liquid layer less leaves more than is wanted.
  light.phi = floors(ask, --light.liquid);
  return light;
}

}  // namespace slicecorr::detail
