// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "cure/limits.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "cure/black_light.hpp"
#include "cure/limit_doses.hpp"
#include "slicecorr/dose.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/gel_time.hpp"
#include "slicecorr/inhibited.hpp"
#include "slicecorr/light_unit.hpp"
#include "slicecorr/units.hpp"

namespace slicecorr {

namespace {

using detail::alike_black;
using detail::black_as_a_rule;
using detail::Counts;
using detail::gels;
using detail::has_own_speeds;
using detail::is_continuous;
using detail::LimitDoses;
using detail::most_black;
using detail::weakest_layer;

std::string pace_in_words(const CureModel& model, const Process& process, Counts counts) {
  if (!is_continuous(process)) return fmt::format("exposed for {:g} s", process.exposure_s);
  if (!has_own_speeds(process)) return fmt::format("at {:g} mm/h", process.speed_mm_h);
  const std::vector<double>& ratio = model.exposure_ratio;
  const auto [least, most] = std::minmax_element(ratio.begin(), ratio.end());
  const auto slice = static_cast<int>((counts == Counts::most ? most : least) - ratio.begin());
  return fmt::format("in slice {}, at {:g} mm/h,", slice, slice_speed_mm_h(process, slice));
}

/// "layer 3, exposed for 1.5 s," where exposures differ.
std::string failing_layer(const CureModel& model, const Process& process, int layer) {
  const double exposure = layer_exposure_s(process, layer);
  if (!model.heights.alike()) {
    return fmt::format("layer {}, {:g} um high and exposed for {:.5g} s,", layer,
                       model.heights.of(layer, model.layer_um), exposure);
  }
  return model.exposure_ratio.empty()
             ? fmt::format("exposed for {:.5g} s", exposure)
             : fmt::format("layer {}, exposed for {:.5g} s,", layer, exposure);
}

/// "29.7 mW/cm²".
std::string full_light(const Printer& printer) {
  return fmt::format("{:g} {}", printer.calibration.back().intensity_mw_cm2,
                     unit_of_light(printer.unit));
}
std::string black_light(const Printer& printer) {
  return fmt::format("{:g} {}", printer.calibration.front().intensity_mw_cm2,
                     unit_of_light(printer.unit));
}

detail::Verdict inhibited_verdict(const CureModel& model, const Printer& printer,
                                  const Process& process, const LimitDoses& doses) {
  detail::Verdict v;
  const InhibitedKernel& kernel = *model.inhibited();
  const std::vector<double> blue = level_intensities(printer);
  const std::string pace = pace_in_words(model, process, Counts::least);
  const int s = kernel.strongest_setting(), top = kernel.levels() - 1;
  const double full =
      kernel.steady_dose(s, top) * (has_own_speeds(process) ? model.least_ratio() : 1.0);
  // Both lights as they are in the slice that has the most UV light over its blue light.
  const double share = kernel.blue_share(s);
  if (full <= 1.0) {
    v.weak = fmt::format(
        "the resin never gels under UV light: {} full light ({:g} mW/cm² over {:.4g} mW/cm² of UV) "
        "reaches {:.4g} of the dose aimed at",
        pace, blue.back() * share, kernel.setting_uv_mw_cm2(s, top) * share, full);
  } else if (!gels(model, doses.lit) && has_own_speeds(process)) {
    const int cap = kernel.highest_usable_level(s);
    v.weak = fmt::format(
        "the resin would cure to the window: {} the brightest light that leaves a dead zone under UV "
        "light of {:.4g} mW/cm², {:.4g} mW/cm², reaches {:.4g} of the dose aimed at",
        pace, kernel.setting_uv_mw_cm2(s, cap) * share, blue[static_cast<std::size_t>(cap)] * share,
        doses.lit);
  } else if (!gels(model, doses.lit)) {
    const int cap = kernel.highest_usable_level(s);
    v.weak = fmt::format(
        "the resin would cure to the window: {} it takes {:.4g} mW/cm² of blue light to gel, and "
        "UV light of {:.4g} mW/cm² leaves {} only up to {:.4g} mW/cm²",
        pace, kernel.critical_intensity_mw_cm2(s) * share, kernel.setting_uv_mw_cm2(s, cap) * share,
        process.uv.dead_zone_um > 0 ? "the dead zone asked for" : "a dead zone",
        blue[static_cast<std::size_t>(cap)] * share);
  } else if (model.lifts) {
    const int cap = kernel.highest_usable_level(s);
    const auto joint_of = [&](int layer) {
      if (kernel.alike()) return kernel.exact(s, cap, 1.0) * model.ratio(layer);
      const int of_layer =
          std::min(cap, kernel.highest_usable_level(kernel.setting_of_slice(layer)));
      return kernel.added(layer, of_layer, layer) * model.ratio(layer);
    };
    int weakest = weakest_layer(model);
    for (int n = 0; n < static_cast<int>(model.own_a.size()); ++n) {
      if (joint_of(n) < joint_of(weakest)) weakest = n;
    }
    const double joint = joint_of(weakest);
    if (joint < model.lifts->green_strength) {
      v.weak = fmt::format(
          "a layer does not hold when the platform lifts: {} the brightest light that leaves a dead zone "
          "({:.4g} mW/cm²) leaves {:.4g} of the gel dose at the layer's far edge, where {:g} must be; "
          "expose for at least {:.4g} s, or take thinner layers",
          failing_layer(model, process, weakest), blue[static_cast<std::size_t>(cap)], joint,
          model.lifts->green_strength,
          layer_exposure_s(process, weakest) * model.lifts->green_strength /
              std::max(joint, 1e-300));
    }
  }
  if (doses.black >= 1.0) {
    v.black = fmt::format(
        "black pixels gel the resin: {} the light of black ({:g} mW/cm²) adds up to {:.4g} of the "
        "dose aimed at",
        pace_in_words(model, process, Counts::most), blue.front(), doses.black);
  }
  return v;
}

/// What full light leaves of a critical dose at a layer's far edge, where it is least.
double left_at_far_edge(const CureModel& model, const LimitDoses& doses) {
  const int weakest = weakest_layer(model);
  return model.bleaching() ? model.bleaching()->after(model.phi_max() * model.ratio(weakest),
                                                      model.height(weakest), 0.0)
         : model.lifts     ? doses.lit * model.lifts->green_strength
                           : doses.lit;
}

detail::Verdict layerwise_verdict(const CureModel& model, const Printer& printer,
                                  const Process& process, const LimitDoses& doses) {
  detail::Verdict v;
  if (!gels(model, doses.lit)) {
    const std::string asks =
        model.lifts ? fmt::format(", where {:g} must be", model.lifts->green_strength) : "";
    v.weak = fmt::format(
        "a layer does not {}: {} full light ({}) leaves {:.4g} of the critical "
        "dose at its far edge{}",
        model.lifts ? "hold when the platform lifts" : "gel through",
        failing_layer(model, process, weakest_layer(model)), full_light(printer),
        left_at_far_edge(model, doses), asks);
  }
  if (doses.black >= 1.0) {
    const auto rule = static_cast<int>(model.exposure_ratio.size());
    const bool as_a_rule = black_as_a_rule(model);
    const int layer =
        as_a_rule ? std::max(0, rule - 1) : most_black(model, model.exposure_ratio).layer;
    v.black = fmt::format(
        "black pixels gel the resin: {} the light of black ({}) adds up to {:.4g} of the "
        "critical dose",
        failing_layer(model, process, layer), black_light(printer),
        as_a_rule ? model.ratio(rule) * alike_black(model) : doses.black);
  }
  return v;
}

/// The least depth of resin, in whole slices, with which full light gels it; `phi` > 1 of the weakest.
double least_depth_um(const CureModel& model, double phi) {
  if (model.gel_time()) return model.slices_to_gel() * model.layer_um;
  double slices = std::max(1, model.slices_to_gel() - 1);
  while (-phi * std::expm1(-slices * model.eta * units::kLn10) <= 1.0) ++slices;
  return slices * model.layer_um;
}

detail::Verdict continuous_verdict(const CureModel& model, const Printer& printer,
                                   const Process& process, const LimitDoses& doses) {
  detail::Verdict v;
  const std::string pace = pace_in_words(model, process, Counts::least);
  const double phi = model.phi_max() * model.least_ratio();
  if (!gels(model, doses.lit) && phi > 1.0) {
    v.weak = fmt::format(
        "the resin is not deep enough: {} {:g} um of it let full light ({}, phi "
        "{:.4g}) reach {:.4g} of the dose aimed at; it takes at least {:g} um",
        pace, model.bath_slices * model.layer_um, full_light(printer), phi, doses.lit,
        least_depth_um(model, phi));
  } else if (!gels(model, doses.lit)) {
    v.weak = fmt::format(
        "the resin never gels: {} even full light ({}, phi {:.4g}) stays below "
        "the critical intensity",
        pace, full_light(printer), doses.lit);
  }
  if (doses.black >= 1.0) {
    const bool back = model.mirrored_slices > 0;
    v.black = fmt::format(
        "black pixels gel the resin{}: {} the light of black ({}, {} {:.4g}) "
        "reaches the critical {}",
        back ? " beside the platform, which sends light back" : "",
        pace_in_words(model, process, Counts::most), black_light(printer), back ? "dose" : "phi",
        doses.black, back ? "one" : "intensity");
  }
  return v;
}

}  // namespace

detail::Verdict detail::verdict(const LitPlace& place, const Printer& printer,
                                const Process& process) {
  const CureModel& model = *place.model;
  const LimitDoses doses = limit_doses(model);
  Verdict v = model.inhibited()        ? inhibited_verdict(model, printer, process, doses)
              : is_continuous(process) ? continuous_verdict(model, printer, process, doses)
                                       : layerwise_verdict(model, printer, process, doses);
  if (!place.lit) v.weak.clear();
  return v;
}

void detail::check_stage_speed(const Printer& printer, const Process& process) {
  if (is_continuous(process) && printer.max_speed_mm_h > 0 &&
      process.speed_mm_h > printer.max_speed_mm_h) {
    throw InputError(
        fmt::format("speed {:g} mm/h is beyond the stage of printer '{}', which reaches {} mm/h",
                    process.speed_mm_h, printer.name, printer.max_speed_mm_h));
  }
}

void check_feasible(const CureModel& model, const Printer& printer, const Process& process) {
  detail::check_stage_speed(printer, process);
  const detail::LitPlace place{&model};
  const Printer lit = as_lit(printer, process);
  const detail::Verdict v = detail::verdict(place, lit, process);
  if (v.weak.empty() && v.black.empty()) return;
  throw InfeasibleError(v.weak + (v.weak.empty() || v.black.empty() ? "" : "; ") + v.black + "; " +
                        detail::ways_out({place}, lit, process));
}

double detail::long_run_dose(const CureModel& model, double mw_cm2) {
  const GelTimeKernel& kernel = *model.gel_time();
  const int bath = model.bath_slices;
  return bath > 0 ? kernel.dose_at_end(mw_cm2, bath) : kernel.phi(mw_cm2);
}

}  // namespace slicecorr
