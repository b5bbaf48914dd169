// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "cure/limit_doses.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "cure/black_light.hpp"
#include "cure/limits.hpp"
#include "slicecorr/dose.hpp"
#include "slicecorr/gel_time.hpp"
#include "slicecorr/inhibited.hpp"

namespace slicecorr::detail {

bool has_own_speeds(const Process& process) {
  return is_continuous(process) && !process.slice_speed_mm_h.empty() &&
         process.slice_lamps == SliceLamps::stay;
}

double pace_mm_h(const CureModel& model, const Process& process, Counts counts) {
  if (!has_own_speeds(process)) return process.speed_mm_h;
  // A lamp that fades counts, too.
  double least_mm_h = std::numeric_limits<double>::infinity(), most_mm_h = 0;
  for (int n = 0; n < static_cast<int>(model.exposure_ratio.size()); ++n) {
    const double mm_h = model.ratio(n) * slice_speed_mm_h(process, n);
    least_mm_h = std::min(least_mm_h, mm_h);
    most_mm_h = std::max(most_mm_h, mm_h);
  }
  return counts == Counts::most ? most_mm_h / model.greatest_ratio()
                                : least_mm_h / model.least_ratio();
}

namespace {

/// What full light leaves of a normal exposure's dose at a layer's far edge.
double leaves(const CureModel& model, int layer) { return model.ratio(layer) * model.a_of(layer); }

}  // namespace

int weakest_layer(const CureModel& model) {
  int weakest = 0;
  const int own = static_cast<int>(std::max(model.exposure_ratio.size(), model.own_a.size()));
  for (int n = 1; n < own; ++n) {
    if (leaves(model, n) < leaves(model, weakest)) weakest = n;
  }
  return weakest;
}

LimitDoses limit_doses(const CureModel& model) {
  if (model.inhibited()) {
    const InhibitedKernel& kernel = *model.inhibited();
    // A lamp that changes from slice to slice is weaker where a slice needs less.
    const int s = kernel.strongest_setting();
    const bool moving = model.mode == ExposureMode::continuous;
    // Layer by layer a slice's share of the light counts, and not for how long it is shown.
    const auto share = [&](int setting) {
      return std::pow(std::min(1.0, kernel.blue_share(setting)), kernel.kinetics().m);
    };
    const int cap = kernel.highest_usable_level(s);
    double lit = kernel.steady_dose(s, cap), black = kernel.steady_dose(0, 0);
    if (!kernel.alike()) {
      // The highest layers get least of full light, the lowest most of black, and most comes back at the platform.
      std::vector<double> um = kernel.heights().um();
      if (um.empty()) um.push_back(model.layer_um);
      constexpr double far_um = 1e9;
      for (const double height : um) {
        lit = std::min(lit, kernel.steady_dose_at(s, cap, {height, far_um}));
        black = std::max(black, kernel.steady_dose_at(0, 0, {height, 0}));
      }
    }
    return {lit * (moving ? model.least_ratio() : share(s)),
            black * (moving ? model.greatest_ratio() : 1.0)};
  }
  if (model.gel_time() && model.mode == ExposureMode::layerwise) {
    const GelTimeKernel& kernel = *model.gel_time();
    const int weakest = weakest_layer(model);
    const double holds = model.lifts ? model.lifts->green_strength : 1.0;
    return {kernel.dose_through_layer(kernel.level_mw_cm2(kernel.levels() - 1),
                                      model.ratio(weakest), weakest, model.height(weakest)) /
                holds,
            most_black(model, model.exposure_ratio).dose};
  }
  if (model.mode == ExposureMode::layerwise) {
    const int weakest = weakest_layer(model);
    const double full = model.phi_max() * model.ratio(weakest);
    const double holds = model.lifts ? model.lifts->green_strength : 1.0;
    return {model.bleaching() ? full / model.bleaching()->after(holds, -model.height(weakest), 0.0)
                              : full * model.a_of(weakest) / holds,
            most_black(model, model.exposure_ratio).dose};
  }
  if (const GelTimeKernel* const kernel = model.gel_time()) {
    // Slices count for no less than the least time and the least light of any, and for no more than the most.
    LimitDoses doses{std::numeric_limits<double>::infinity(), 0};
    for (int n = 0; n <= static_cast<int>(model.exposure_ratio.size()); ++n) {
      const double share = std::pow(kernel->root_share(n), 2), time = model.ratio(n) / share;
      const double full = kernel->level_mw_cm2(kernel->levels() - 1) * share,
                   black = kernel->level_mw_cm2(0) * share * model.returned(0);
      doses.lit = std::min(doses.lit, time * long_run_dose(model, full));
      doses.black = std::max(doses.black, time * long_run_dose(model, black));
    }
    return doses;
  }
  // Where slices count for more than others, whatever their order.
  return {model.steady(model.phi_max()) * model.least_ratio(),
          model.steady(model.phi_min()) * model.greatest_ratio() * model.returned(0)};
}

bool is_plain_layerwise(const CureModel& model) {
  return model.mode == ExposureMode::layerwise && !model.inhibited();
}

bool gels(const CureModel& model, double lit_dose) {
  return is_plain_layerwise(model) ? lit_dose >= 1.0 - 1e-12 : lit_dose > 1.0;
}

bool black_as_a_rule(const CureModel& model) {
  const auto rule = static_cast<int>(model.exposure_ratio.size());
  return model.ratio(rule) * alike_black(model) >= 1.0;
}

}  // namespace slicecorr::detail
