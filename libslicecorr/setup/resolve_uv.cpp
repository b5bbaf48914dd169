// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <fmt/format.h>

#include <string>
#include <vector>

#include "setup/lamps.hpp"
#include "setup/resolver.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/flow.hpp"
#include "slicecorr/load_printer.hpp"
#include "slicecorr/supports.hpp"

namespace slicecorr::detail {

/// What needs flow needs more of printer and resin than other prints do.
void Resolver::resolve_even_dead_zone(Setup& setup) const {
  const std::string option = o("even_dead_zone");
  std::vector<Feature> features = features_of(setup.printer, setup.resin, setup.process);
  features.push_back(Feature::even_dead_zone);
  try {
    check_supported(features, setup.printer.name, setup.resin.name);
  } catch (const InputError& e) {
    if (setup.process.mode == ExposureMode::layerwise) misfit({"even_dead_zone"}, e.what());
    throw;
  }
  if (auto light = said_of({"uv_mw_cm2", "dead_zone_um", "uv_schedule"}); !light.empty()) {
    light.resize(1);
    light.emplace_back("even_dead_zone");
    misfit(light, fmt::format("{} finds the UV light; expected no {}, {} or {} with it", option,
                              o("uv_mw_cm2"), o("dead_zone_um"), o("uv_schedule")));
  }
  if (!setup.resin.inhibition) {
    wrong(fmt::format("{}: resin '{}' has no [inhibition]; expected one that UV light inhibits",
                      option, setup.resin.name));
  }
  if (!setup.printer.uv) {
    wrong(fmt::format("{}: printer '{}' has no [uv] lamp", option, setup.printer.name));
  }
  const bool by_name = c_.resin_toml.empty() && !c_.resin.empty();
  flow_resin(setup.resin, by_name ? find_definition(c_.resin, "resin") : std::string());
  const bool patterned = setup.printer.uv->patterned;
  const std::string& kind = c_.even_dead_zone;
  if (!patterned && (kind == "uv" || kind == "both")) {
    wrong(fmt::format(
        "{} {}: the UV lamp of printer '{}' floods the window; expected blue or constant", option,
        kind, setup.printer.name));
  }
  Process& process = setup.process;
  process.even_light.reset();
  process.even_dead_zone = kind == "constant"            ? EvenDeadZone::constant
                           : kind == "blue"              ? EvenDeadZone::blue
                           : kind == "uv"                ? EvenDeadZone::uv
                           : kind == "both" || patterned ? EvenDeadZone::both
                                                         : EvenDeadZone::blue;
  // The light is found with the part; until then all that can be said is what the lamp can do.
  process.uv = {};
  process.uv.kind = UvKind::per_slice;
  process.uv.uv_mw_cm2 = setup.printer.uv->max_mw_cm2();
}

void Resolver::resolve_uv(Setup& setup) const {
  UvSchedule& uv = setup.process.uv;
  if (!c_.window_cure.empty()) setup.process.allow_window_cure = c_.window_cure == "allow";
  const std::string intensity = o("uv_mw_cm2"), zone = o("dead_zone_um"),
                    schedule = o("uv_schedule");
  if (c_.uv_mw_cm2 > 0 && c_.dead_zone_um > 0) {
    misfit({"uv_mw_cm2", "dead_zone_um"},
           fmt::format("{} and {} are two ways to set the UV light; expected one of them",
                       intensity, zone));
  }
  if (!(c_.uv_mw_cm2 > 0) && !(c_.dead_zone_um > 0)) {
    if (!c_.uv_schedule.empty()) {
      misfit({"uv_schedule"}, fmt::format("{} {}: expected {} with it", schedule, c_.uv_schedule,
                                          c_.uv_schedule == "constant" ? intensity : zone));
    }
    return;
  }
  const std::string& option = c_.uv_mw_cm2 > 0 ? intensity : zone;
  if (!setup.resin.inhibition) {
    wrong(fmt::format("{}: resin '{}' has no [inhibition]; expected one that UV light inhibits",
                      option, setup.resin.name));
  }
  if (!setup.printer.uv) {
    wrong(fmt::format("{}: printer '{}' has no [uv] lamp", option, setup.printer.name));
  }
  const bool patterned = setup.printer.uv->patterned;
  uv = {};
  if (c_.uv_mw_cm2 > 0) {
    if (!c_.uv_schedule.empty() && c_.uv_schedule != "constant") {
      wrong(fmt::format("{} {} holds a dead zone; expected {} in place of {}", schedule,
                        c_.uv_schedule, zone, intensity));
    }
    uv.kind = UvKind::constant;
    uv.uv_mw_cm2 = c_.uv_mw_cm2;
    return;
  }
  if (c_.uv_schedule == "constant") {
    wrong(fmt::format("{} constant: expected {} in place of {}", schedule, intensity, zone));
  }
  if (c_.uv_schedule == "patterned" && !patterned) {
    wrong(fmt::format("{} patterned: the UV lamp of printer '{}' floods the window", schedule,
                      setup.printer.name));
  }
  if (setup.printer.uv_flat_field && !patterned) {
    // By slice no place needs more.
    const double weakest_mw_cm2 = uv_for_weakest_place(setup, c_.dead_zone_um);
    if (c_.uv_schedule.empty()) {
      uv.kind = UvKind::constant;
      uv.uv_mw_cm2 = weakest_mw_cm2;
      return;
    }
  }
  uv.kind = c_.uv_schedule == "patterned" || (c_.uv_schedule.empty() && patterned)
                ? UvKind::patterned
                : UvKind::per_slice;
  uv.dead_zone_um = c_.dead_zone_um;
}

}  // namespace slicecorr::detail
