// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "setup/assume.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>

#include "slicecorr/assumed_light.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/supports.hpp"

namespace slicecorr::detail {

namespace {

/// What is assumed needs lifts, of which nobody knows what they exchange.
void check_assumed(const Assuming& a, const Setup& setup) {
  const auto o = [&](std::string_view name) { return setting_name(a.names, name); };
  const auto wrong = [](const std::string& text) { throw InputError(text); };
  const Process& p = setup.process;
  const std::string option = o("assume");
  if (p.mode != ExposureMode::layerwise || p.lifts != Lifts::each) {
    wrong(fmt::format(
        "{} counts on exposures after which the platform lifts; expected {} layerwise, and {} "
        "each, with it",
        option, o("mode"), o("lifts")));
  }
  if (p.uv.kind != UvKind::off || p.even_dead_zone != EvenDeadZone::off) {
    wrong(fmt::format(
        "{} says no mW/cm², by which UV light inhibits; expected no {}, {} or {} with it", option,
        o("uv_mw_cm2"), o("dead_zone_um"), o("even_dead_zone")));
  }
  if (p.lift_exchange != kUnknownExchange) {
    wrong(fmt::format(
        "{} makes layers hold whatever lifts exchange; expected no {} with it, by which first "
        "layers stay liquid",
        option, o("lift_exchange")));
  }
  if (a.choices.dc_mj_cm3 > 0 || a.choices.dose_factor > 0) {
    wrong(fmt::format("{} takes the dose from the exposure; expected no {} or {} with it", option,
                      o("dc_mj_cm3"), o("dose_factor")));
  }
}

/// The highest layer is the one that holds last.
double highest_um(double layer_um, const Process& p) {
  for (const double um : p.layer_heights_um) layer_um = std::max(layer_um, um);
  return layer_um;
}

}  // namespace

void assume_strength(const SetupChoices& c, const StackInfo* assumed, Process& process) {
  if (!assumed || process.mode != assumed->process->mode) return;
  double& green = process.green_strength;
  const bool said = c.green_strength > 0;
  const bool kept = c.printer.empty() && c.printer_toml.empty();
  if (said && kept) green = assumed_green_strength(green);
  if (!said && !kept) green = holds_of_assumed(green);
}

void assume_dose(const Assuming& a, double layer_um, Setup& setup) {
  check_assumed(a, setup);
  Process& p = setup.process;
  // What an archive says prints; what is chosen in its place may not. A stack that was corrected so keeps
  // the exposure of the archive that it was made from in its dose.
  double exposure_s = p.exposure_s * usual_light_share(p);
  if (a.assumed) {
    const Process& made = *a.assumed->process;
    exposure_s =
        exposure_of_assumed_dose(*a.assumed->resin, highest_um(a.assumed->grid.layer_um, made),
                                 holds_of_assumed(made.green_strength));
  } else if (a.times && a.times->exposure_s > 0) {
    Process archive;
    archive.light_share = a.times->light_share;
    exposure_s = a.times->exposure_s * usual_light_share(archive);
  }
  layer_um = highest_um(layer_um, p);
  setup.resin = with_assumed_dose(std::move(setup.resin), layer_um, exposure_s, p.green_strength);
  setup.resin.display = setup.printer.name;
  p.green_strength = assumed_green_strength(p.green_strength);
}

void assume_errors(Setup& setup) {
  std::vector<Feature> features = features_of(setup.printer, setup.resin, setup.process);
  features.push_back(Feature::derivatives);
  if (find_unsupported(features, Verdict::refused)) return;
  setup.uncertainty =
      parse_uncertainty(std::string(kAssumedUncertainty), setup.process.mode, 1, {});
}

}  // namespace slicecorr::detail
