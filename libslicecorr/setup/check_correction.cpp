// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <fmt/format.h>

#include <algorithm>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "slicecorr/absorbance_in_layer.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/setup.hpp"
#include "slicecorr/supports.hpp"

namespace slicecorr {

namespace {

/// An error of the exchange needs lifts, an exchange that it is an error of, and room for it: at x = 0 the
/// last exposure decides that has any light at all, and doses fall at once.
void check_exchange(const Setup& setup) {
  const double sd = setup.uncertainty ? setup.uncertainty->sd(UncertainInput::exchange) : 0.0;
  if (!(sd > 0)) return;
  if (setup.printer.platform_reflectance > 0) {
    throw InputError(
        "the exchange is off below a platform that sends light back, where derivatives are differences of "
        "ha, light, stray and m alone; expected no error of exchange, or a platform that takes light up");
  }
  if (setup.printer.resin_depth_um > 0) {
    throw InputError(
        "the exchange is off in resin that ends, where derivatives are differences of ha, light, stray and m "
        "alone; expected no error of exchange, or no depth");
  }
  if (!setup.process.layer_heights_um.empty()) {
    throw InputError(
        "the exchange is off in layers of different heights, where derivatives are differences of ha, light, "
        "stray and m alone; expected no error of exchange, or layers of one height");
  }
  Process process = setup.process;
  leave_out_lifts(setup.printer, setup.resin, process);
  if (process.mode != ExposureMode::layerwise || process.lifts == Lifts::none) {
    throw InputError(
        "the exchange is off, and nothing is looked at that lifts exchange; expected layer by layer "
        "exposure with lifts, or no error of exchange");
  }
  if (process.lift_exchange < 0) {
    throw InputError(
        "the exchange is off, and nobody says of what share; expected lift_exchange, or no error of "
        "exchange: while it is not known corrections and reports allow for all shares");
  }
  if (process.lift_exchange < sd) {
    throw InputError(fmt::format(
        "lifts exchange a share of {:g}, which is off by {:g}; expected an error of {:g} at most, "
        "the share itself: near 0 doses fall at once, and nothing can be said to first order",
        process.lift_exchange, sd, process.lift_exchange));
  }
}

/// Shelves are made column by column, of doses that are sums of the slices' light.
void check_overhangs(const Process& process, std::span<const Feature> features) {
  if (process.overhangs == Overhangs::bright) return;
  for (const Feature other : {Feature::layerwise, Feature::even_dead_zone, Feature::uv_constant,
                              Feature::uv_per_slice, Feature::uv_patterned, Feature::gel_time,
                              Feature::bleaching, Feature::spread, Feature::wanted_doses}) {
    if (std::find(features.begin(), features.end(), other) == features.end()) continue;
    throw InputError(
        fmt::format("features over gaps gel early (overhangs early) in continuous exposure, where "
                    "doses are sums of light and columns stand alone: not with {}; expected "
                    "overhangs bright",
                    name_of(other)));
  }
}

/// Where derivatives are differences between prints: noise is off in each slice by itself.
constexpr std::pair<Feature, const char*> kNoNoise[] = {
    {Feature::uv_constant, "under UV light"},
    {Feature::uv_per_slice, "under UV light"},
    {Feature::uv_patterned, "under UV light"},
    {Feature::gel_time, "with a resin of model \"gel-time\""},
    {Feature::bleaching, "with a resin that bleaches"},
    {Feature::vat_depth, "where the resin ends above the window"},
    {Feature::reflectance, "below a platform that sends light back"},
    {Feature::own_heights, "of layers of different heights"},
    {Feature::moved_heights, "of layers of different heights"},
    {Feature::pulsed_grey, "with grey by pulses"},
};

/// Where light spreads, columns are held together in both cases by sums of light.
constexpr Feature kRobustAlone[] = {Feature::uv_constant, Feature::uv_per_slice,
                                    Feature::uv_patterned, Feature::gel_time, Feature::bleaching};

bool asks_for_skin(const Process& p) {
  return p.mode == ExposureMode::layerwise && p.lifts == Lifts::each && p.skin != Process().skin;
}

/// A part that ends while its exposure still falls; empty where it does not.
std::string fade_notice(const Process& p, int layers) {
  const int faded = p.bottom_layers + p.fade_layers;
  const bool falls = p.mode == ExposureMode::layerwise && p.layer_exposure_s.empty() &&
                     p.fade_layers > 0 && p.bottom_exposure_s > p.exposure_s;
  if (!falls || layers <= 0 || faded < layers) return {};
  return fmt::format(
      "the exposure falls over the first {} layers (bottom_layers, fade_layers), and the part ends after {}: "
      "no layer gets the {:g} s of normal ones, the last one gets {:.3g} s",
      faded, layers, p.exposure_s, layer_exposure_s(p, layers - 1));
}

}  // namespace

void check_uncertain(const Setup& setup) {
  std::vector<Feature> features = features_of(setup.printer, setup.resin, setup.process);
  features.push_back(Feature::derivatives);
  check_supported(features, setup.printer.name, setup.resin.name);
  // What three of these, or an input, bring.
  const auto refuse = [](const char* where) {
    throw InputError(fmt::format("how sure a print is can't be said {}", where));
  };
  const UvKind uv = setup.process.uv.kind;
  if (uv != UvKind::off && !setup.printer.spread.none()) {
    refuse(
        "where light spreads under UV light; expected a printer without blue.spread, or no UV light");
  }
  if (setup.uncertainty && setup.uncertainty->noise > 0) {
    for (const auto& [feature, where] : kNoNoise) {
      if (std::find(features.begin(), features.end(), feature) == features.end()) continue;
      refuse(fmt::format("of noise {}; expected no error of noise", where).c_str());
    }
  }
  if (uv == UvKind::patterned && setup.uncertainty &&
      setup.uncertainty->sd(UncertainInput::stray) > 0) {
    refuse("of stray light where UV light has a pattern; expected no error of stray");
  }
  check_exchange(setup);
  if (setup.resin.scatter_um2_per_um > 0) {
    refuse("where light scatters in the resin; expected a resin without it");
  }
}

void check_correction(const Setup& setup, const DesignHas& design) {
  check_corrected(setup.printer, setup.resin, setup.process);
  if (asks_for_skin(setup.process)) refuse_law(setup.resin, LawUse::skins);
  std::vector<Feature> features = features_of(setup.printer, setup.resin, setup.process);
  if (design.doses) features.push_back(Feature::wanted_doses);
  if (design.left_alone) features.push_back(Feature::left_alone);
  check_overhangs(setup.process, features);
  if (setup.uncertainty) check_uncertain(setup);
  const bool robust = setup.uncertainty && setup.uncertainty->robust;
  if (robust) features.push_back(Feature::robust);
  check_supported(features, setup.printer.name, setup.resin.name);
  const auto has = [&](Feature f) {
    return std::find(features.begin(), features.end(), f) != features.end();
  };
  if (robust && has(Feature::spread) && setup.uncertainty->from_fit) {
    throw InputError(
        "a correction can't be robust against the covariance of a fit where light spreads from pixel to "
        "pixel; expected errors that are said one by one");
  }
  for (const Feature other : kRobustAlone) {
    if (!robust || !has(Feature::spread) || !has(other)) continue;
    throw InputError(fmt::format(
        "a correction can't be robust where light spreads from pixel to pixel with {}; expected "
        "a printer and a resin without spread",
        name_of(other)));
  }
  if (robust && design.doses && has(Feature::spread)) {
    throw InputError(
        "a correction can't be robust with wanted doses where light spreads from pixel to pixel, since pixels are then "
        "chosen for either; expected a part without wanted doses, or a printer and a resin without spread");
  }
  if (robust && has(Feature::spread) && setup.process.spread_rounds == 0) {
    throw InputError(
        "a correction can't be robust where light spreads from pixel to pixel and columns are corrected "
        "alone; expected rounds");
  }
  if (robust && !setup.uncertainty->from_fit && setup.uncertainty->sd(UncertainInput::m) > 0) {
    throw InputError(
        "a correction can't be robust against an exponent that is off by itself, since doses rise "
        "with it here and fall there; expected its errors from a fit, or no error of m");
  }
}

Setup setup_to_correct(const SliceSource& target, Setup setup, const ExecutionContext& context) {
  check_absorbance_height(setup.resin, target.grid().layer_um);
  check_correction(setup, {target.left_alone() != nullptr, target.doses() != nullptr});
  const char* const heights = leave_out_heights(setup.printer, setup.resin, setup.process);
  if (heights && target.edge_heights()) context.tell(heights);
  const char* const lifts = leave_out_lifts(setup.printer, setup.resin, setup.process);
  if (lifts) context.tell(lifts);
  const Process& process = setup.process;
  if (process.mode == ExposureMode::layerwise && process.uv.kind != UvKind::off &&
      process.lifts == Lifts::none) {
    context.tell(
        "under UV light nothing is lifted where nobody says that it is (lifts each): doses count at the end "
        "alone");
  }
  const char* const cap = leave_out_cap(setup.printer, setup.resin, setup.process);
  if (cap) context.tell(cap);
  if (const std::string fades = fade_notice(process, target.grid().layers); !fades.empty()) {
    context.tell(fades);
  }
  return setup;
}

}  // namespace slicecorr
