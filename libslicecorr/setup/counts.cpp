// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "setup/counts.hpp"

#include <fmt/format.h>

#include <string>
#include <string_view>

#include "slicecorr/light_spreads.hpp"
#include "slicecorr/misfit.hpp"

namespace slicecorr {

void detail::check_counts(const Setup& setup, const SetupChoices& choices, ChoiceNames names) {
  const auto o = [&](std::string_view name) { return setting_name(names, name); };
  const Process& p = setup.process;
  const bool continuous = p.mode == ExposureMode::continuous;
  // Where levels are tried, both count, whatever the law (tried_column.hpp).
  const bool tried = continuous && !setup.resin.adds_up();
  for (const std::string_view name : {"edge_aim_um", "gap_shortfall"}) {
    if (!is_said(*find_setting(name), choices) || tried) continue;
    if (!continuous || p.uv.kind != UvKind::off) {
      throw MisfitError({std::string(name)},
                        fmt::format("{} changes nothing {}; expected it not to be given", o(name),
                                    continuous ? "under UV light" : "layer by layer"));
    }
  }
  const bool rounds = is_said(*find_setting("rounds"), choices);
  if ((rounds || choices.spread_correction == "off") &&
      !light_spreads(setup.printer, setup.resin, p)) {
    const char* const said = rounds ? "rounds" : "spread_correction";
    throw MisfitError(
        {said},
        fmt::format("{} changes nothing where no light spreads from pixel to pixel; expected "
                    "it not to be given, or a printer or a resin whose file says how it spreads",
                    o(said)));
  }
  if (choices.platform_features == "uncapped" && p.omega_max >= kNoCap) {
    throw MisfitError({"platform_features"},
                      fmt::format("{} says what a cap of the dose leaves out; expected {} with it",
                                  o("platform_features"), o("omega_max")));
  }
  if (choices.gap_um > 0 && choices.even_dead_zone.empty()) {
    if (!continuous) {
      throw MisfitError(
          {"gap_um"},
          fmt::format(
              "{} changes nothing layer by layer: suction is judged in continuous exposure; "
              "expected it not to be given",
              o("gap_um")));
    }
    if (!(setup.resin.viscosity_pa_s > 0)) {
      throw InputError(fmt::format(
          "{} says where suction is judged, and nobody knows suction without the viscosity "
          "of resin '{}'; expected viscosity_pa_s in its file with it",
          o("gap_um"), setup.resin.name));
    }
  }
}

}  // namespace slicecorr
