// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "cure/limits.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <optional>

#include "cure/black_light.hpp"
#include "cure/margin.hpp"
#include "slicecorr/dose.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/gel_time.hpp"
#include "slicecorr/inhibited.hpp"
#include "slicecorr/light_unit.hpp"
#include "slicecorr/limit.hpp"
#include "slicecorr/units.hpp"
#include "support/numbers/bracket.hpp"

namespace slicecorr {

namespace {

using detail::alike_black;
using detail::LitPlace;
using detail::most_black;

// Limits are computed in another way than models are made. So far inside a limit (a share of it) both
// agree.
using detail::kMargin;

bool is_continuous(const Process& process) { return process.mode == ExposureMode::continuous; }

/// Whether slices go at speeds of their own and lamps stay as they are: the one speed of the process is
/// then none of any slice.
bool has_own_speeds(const Process& process) {
  return is_continuous(process) && !process.slice_speed_mm_h.empty() &&
         process.slice_lamps == SliceLamps::stay;
}

/// Which slices fail first: those that count for most where black gels, those that count for least where
/// full light does not.
enum class Counts { most, least };

std::string pace_in_words(const CureModel& model, const Process& process, Counts counts) {
  if (!is_continuous(process)) return fmt::format("exposed for {:g} s", process.exposure_s);
  if (!has_own_speeds(process)) return fmt::format("at {:g} mm/h", process.speed_mm_h);
  const std::vector<double>& ratio = model.exposure_ratio;
  const auto [least, most] = std::minmax_element(ratio.begin(), ratio.end());
  const auto slice = static_cast<int>((counts == Counts::most ? most : least) - ratio.begin());
  return fmt::format("in slice {}, at {:g} mm/h,", slice, slice_speed_mm_h(process, slice));
}

/// The speed, mm/h, that times a dose of `doses_of` is the speed at which that dose is 1: the process's,
/// or that of all slices where they have their own.
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

/// What full light leaves of a normal exposure's dose at a layer's far edge.
double leaves(const CureModel& model, int layer) { return model.ratio(layer) * model.a_of(layer); }

/// The layer with the shortest exposure, or the highest for it: if it gels, all do.
int weakest_layer(const CureModel& model) {
  int weakest = 0;
  const int own = static_cast<int>(std::max(model.exposure_ratio.size(), model.own_a.size()));
  for (int n = 1; n < own; ++n) {
    if (leaves(model, n) < leaves(model, weakest)) weakest = n;
  }
  return weakest;
}

/// The relative dose of lit pixels, which must be above 1 (layer by layer without UV: at least 1),
/// and that of black, which must be below.
struct Doses {
  double lit = 0, black = 0;
};
Doses doses_of(const CureModel& model) {
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
    Doses doses{std::numeric_limits<double>::infinity(), 0};
    for (int n = 0; n <= static_cast<int>(model.exposure_ratio.size()); ++n) {
      const double share = std::pow(kernel->root_share(n), 2), time = model.ratio(n) / share;
      const double full = kernel->level_mw_cm2(kernel->levels() - 1) * share,
                   black = kernel->level_mw_cm2(0) * share * model.returned(0);
      doses.lit = std::min(doses.lit, time * detail::long_run_dose(model, full));
      doses.black = std::max(doses.black, time * detail::long_run_dose(model, black));
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

/// Whether the dose of lit pixels is enough. Layer by layer an exposure of just the least time is
/// feasible, so rounding is allowed for.
bool gels(const CureModel& model, double lit_dose) {
  return is_plain_layerwise(model) ? lit_dose >= 1.0 - 1e-12 : lit_dose > 1.0;
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

/// Whether black gels by the normal exposure already, not only by the longer ones of some layers.
bool black_as_a_rule(const CureModel& model) {
  const auto rule = static_cast<int>(model.exposure_ratio.size());
  return model.ratio(rule) * alike_black(model) >= 1.0;
}

detail::Verdict inhibited_verdict(const CureModel& model, const Printer& printer,
                                  const Process& process, const Doses& doses) {
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
double left_at_far_edge(const CureModel& model, const Doses& doses) {
  const int weakest = weakest_layer(model);
  return model.bleaching() ? model.bleaching()->after(model.phi_max() * model.ratio(weakest),
                                                      model.height(weakest), 0.0)
         : model.lifts     ? doses.lit * model.lifts->green_strength
                           : doses.lit;
}

detail::Verdict layerwise_verdict(const CureModel& model, const Printer& printer,
                                  const Process& process, const Doses& doses) {
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
                                   const Process& process, const Doses& doses) {
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

/// Every exposure at most `most_s`.
Process cut(Process p, double most_s) {
  p.exposure_s = std::min(p.exposure_s, most_s);
  p.bottom_exposure_s = std::min(p.bottom_exposure_s, most_s);
  for (double& time_s : p.layer_exposure_s) time_s = std::min(time_s, most_s);
  return p;
}

/// The longest exposure, s, that all layers may get so that black leaves the resin liquid.
/// `normal_s`: the exposure that the model's phi' stands for. Infinite without light of black.
double longest_alike_s(const CureModel& model, double normal_s) {
  return model.phi_min() > 0 ? normal_s / alike_black(model)
                             : std::numeric_limits<double>::infinity();
}

/// The same for the exposures of `process`, each cut to the result: a few layers may be exposed for
/// longer than all of them may.
double longest_for_black_s(const CureModel& model, const Process& process, double normal_s) {
  const double alike_s = longest_alike_s(model, normal_s);
  if (!std::isfinite(alike_s)) return std::numeric_limits<double>::infinity();
  const auto fits = [&](double most_s) {
    return most_black(model, detail::exposure_ratios(cut(process, most_s), normal_s, model.m))
               .dose < 1.0;
  };
  double longest_s = process.exposure_s;
  for (int n = 0; n < static_cast<int>(model.exposure_ratio.size()); ++n) {
    longest_s = std::max(longest_s, layer_exposure_s(process, n));
  }
  const double fits_s = alike_s * (1 - kMargin), gels_s = std::max(longest_s, alike_s);
  if (fits(gels_s)) return alike_s;
  return halved({fits_s, gels_s}, 60, fits).low;
}

struct Failing {
  bool lit = false, black = false;
};

/// Speeds, mm/h, or exposures, s, at which all places print.
struct Paces {
  double least = 0, greatest = std::numeric_limits<double>::infinity();
  bool any() const { return least <= greatest && greatest > 0; }
};

Paces speeds(const std::vector<LitPlace>& places, const Printer& printer, const Process& process) {
  // Every dose is inversely proportional to the speed.
  Paces p;
  for (const LitPlace& place : places) {
    const Doses d = doses_of(*place.model);
    if (place.lit) {
      const double mm_h = pace_mm_h(*place.model, process, Counts::least);
      p.greatest = std::min(p.greatest, mm_h * d.lit / place.needed);
    }
    p.least = std::max(p.least, pace_mm_h(*place.model, process, Counts::most) * d.black);
  }
  p.greatest *= 1 - kMargin;
  if (printer.max_speed_mm_h > 0) p.greatest = std::min(p.greatest, printer.max_speed_mm_h);
  p.least *= 1 + kMargin;
  return p;
}

Paces exposures(const std::vector<LitPlace>& places, const Process& process,
                const Failing& failing) {
  Paces p;
  for (const LitPlace& place : places) {
    const double dose = doses_of(*place.model).lit;
    const double shortest_s = is_plain_layerwise(*place.model)
                                  ? layer_exposure_s(process, weakest_layer(*place.model))
                                  : process.exposure_s;
    if (place.lit) p.least = std::max(p.least, shortest_s * place.needed / dose * (1 + kMargin));
  }
  if (!std::isfinite(p.least)) return {std::numeric_limits<double>::infinity(), 0};
  for (const LitPlace& place : places) {
    const CureModel& model = *place.model;
    const double longest_s = !is_plain_layerwise(model) ? process.exposure_s / doses_of(model).black
                             : failing.lit
                                 ? longest_alike_s(model, process.exposure_s)
                                 : longest_for_black_s(model, process, process.exposure_s);
    p.greatest = std::min(p.greatest, longest_s * (1 - kMargin));
  }
  return p;
}

/// Both ends as text, rounded inwards with as many digits as leave room between them.
struct PaceWords {
  std::string least, greatest;
};
std::optional<PaceWords> in_words(const Paces& p) {
  if (!p.any()) return std::nullopt;
  for (int digits = kLimitDigits; digits <= 15; digits += 2) {
    if (rounded_up(p.least, digits) <= rounded_down(p.greatest, digits)) {
      return PaceWords{p.least > 0 ? at_least(p.least, digits) : "",
                       std::isfinite(p.greatest) ? at_most(p.greatest, digits) : ""};
    }
  }
  return std::nullopt;
}

Failing failing_of(const std::vector<LitPlace>& places) {
  Failing f;
  for (const LitPlace& p : places) {
    const Doses d = doses_of(*p.model);
    f.lit = f.lit || (p.lit && (!gels(*p.model, d.lit) || d.lit < p.needed));
    f.black = f.black || d.black >= 1.0;
  }
  return f;
}

std::string speed_way(const std::vector<LitPlace>& places, const Printer& printer,
                      const Process& process, const Failing& failing) {
  const Paces paces = speeds(places, printer, process);
  const auto words = in_words(paces);
  if (!words) {
    const bool no_travel = std::any_of(places.begin(), places.end(), [](const LitPlace& p) {
      return p.lit && !std::isfinite(p.needed);
    });
    if (no_travel)
      return "no speed works: the stage's travel leaves no slices in which the part's end could "
             "cure";
    if (paces.greatest == printer.max_speed_mm_h) {
      return fmt::format(
          "no speed of the stage of printer '{}' is fast enough for its light of black",
          printer.name);
    }
    return paces.least > 0 && paces.greatest > 0
               ? "no speed works: where lit pixels gel, black ones do, too"
               : "no speed works";
  }
  if (has_own_speeds(process)) {
    const auto of = [](const char* side, const std::string& mm_h) {
      return mm_h.empty() ? mm_h : fmt::format("{} {} mm/h", side, mm_h);
    };
    const std::string most = of("at most", words->greatest), least = of("at least", words->least);
    const std::string between = most.empty() || least.empty() ? "" : " and ";
    return "give each slice " + (failing.lit ? most + between + least : least + between + most);
  }
  const std::string slower = fmt::format("slower than {} mm/h", words->greatest);
  if (words->least.empty()) return "print " + slower;
  const std::string faster = fmt::format("faster than {} mm/h", words->least);
  return failing.lit ? fmt::format("print {} and {}", slower, faster)
                     : fmt::format("print {} and {}", faster, slower);
}

std::string exposure_way(const std::vector<LitPlace>& places, const Process& process,
                         const Failing& failing) {
  const Paces paces = exposures(places, process, failing);
  const auto words = in_words(paces);
  if (!words) {
    return std::isfinite(paces.least)
               ? "no exposure works: where lit pixels gel, black ones do, too"
               : "no exposure works";
  }
  if (failing.lit) {
    std::string text = fmt::format("expose for at least {} s", words->least);
    if (!words->greatest.empty()) text += fmt::format(" and for less than {} s", words->greatest);
    return text;
  }
  // A normal exposure that is too long is so for the first layers, too.
  const char* which = "";
  for (const LitPlace& p : places) {
    const CureModel& model = *p.model;
    if (model.exposure_ratio.empty() || model.inhibited() || doses_of(model).black < 1.0) continue;
    which = black_as_a_rule(model)             ? "all layers "
            : process.layer_exposure_s.empty() ? "the first layers "
                                               : "each layer ";
  }
  return fmt::format("expose {}for less than {} s", which, words->greatest);
}

/// Where doses are no sums: by how much light would have to be multiplied for a dose of it to be
/// `wanted`.
double light_by_trying(const CureModel& model, double wanted, double Doses::*dose) {
  const auto reaches = [&](double factor) {
    CureModel other = model;
    if (model.gel_time()) {
      other.law =
          WithGelTime{std::make_shared<const GelTimeKernel>(model.gel_time()->with_light(factor))};
    }
    for (double& phi : other.level_phi) {
      phi = other.phi(factor * model.intensity_mw_cm2(phi));
    }
    return doses_of(other).*dose >= wanted;
  };
  // In powers of e: no light at all makes no dose.
  constexpr double low = -60, high = 60;
  if (!std::isfinite(wanted) || !reaches(std::exp(high)))
    return std::numeric_limits<double>::infinity();
  return std::exp(halved({low, high}, 60, [&](double ln) { return !reaches(std::exp(ln)); }).high);
}

/// What intensities of full light and of black would make all places print at the speed or exposure
/// asked for. Only without UV light, whose dead zone would matter, too.
std::string light_way(const std::vector<LitPlace>& places, const Printer& printer,
                      const Failing& failing) {
  double full = 0, black = std::numeric_limits<double>::infinity();
  for (const LitPlace& p : places) {
    const Doses d = doses_of(*p.model);
    if (!p.model->adds_up()) {
      if (p.lit) full = std::max(full, light_by_trying(*p.model, p.needed, &Doses::lit));
      black = std::min(black, light_by_trying(*p.model, 1.0, &Doses::black));
      continue;
    }
    if (p.lit) full = std::max(full, std::pow(p.needed / d.lit, 1.0 / p.model->m));
    black = std::min(black, std::pow(1.0 / d.black, 1.0 / p.model->m));
  }
  full *= printer.calibration.back().intensity_mw_cm2 * (1 + kMargin);
  black *= printer.calibration.front().intensity_mw_cm2 * (1 - kMargin);
  // Where no light is enough, less of black changes nothing.
  if (failing.lit && !std::isfinite(full)) return {};
  std::string text;
  if (failing.lit) {
    const bool reaches = is_plain_layerwise(*places.front().model);
    text = fmt::format("with {} {} {}{}", reaches ? "at least" : "more than", at_least(full),
                       unit_of_light(printer.unit), failing.black ? " of full light" : "");
  }
  if (failing.black) {
    text += fmt::format("{}black below {} {}", text.empty() ? "with " : " and ", at_most(black),
                        unit_of_light(printer.unit));
  }
  return text;
}

}  // namespace

detail::Verdict detail::verdict(const LitPlace& place, const Printer& printer,
                                const Process& process) {
  const CureModel& model = *place.model;
  const Doses doses = doses_of(model);
  Verdict v = model.inhibited()        ? inhibited_verdict(model, printer, process, doses)
              : is_continuous(process) ? continuous_verdict(model, printer, process, doses)
                                       : layerwise_verdict(model, printer, process, doses);
  if (!place.lit) v.weak.clear();
  return v;
}

std::string detail::ways_out(const std::vector<LitPlace>& places, const Printer& printer,
                             const Process& process) {
  const Failing failing = failing_of(places);
  std::string text = is_continuous(process) ? speed_way(places, printer, process, failing)
                                            : exposure_way(places, process, failing);
  if (!places.front().model->inhibited()) {
    if (const std::string light = light_way(places, printer, failing); !light.empty()) {
      text += ", or " + light;
    }
  } else if (places.size() == 1 && !places.front().model->inhibited()->ends()) {
    const LitPlace& p = places.front();
    if (const auto uv = working_uv(p.model->inhibited()->kinetics(), p.model->layer_um,
                                   level_intensities(printer), *printer.uv, process, p.needed)) {
      text += fmt::format(", or with {} mW/cm² of UV light", *uv);
    }
  }
  return text;
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
