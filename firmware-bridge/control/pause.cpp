// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "control/pause.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "plan/checks.hpp"

namespace slicecorr::bridge {
namespace {

/// Why lamps can't follow the stage to a stop; empty when they can.
std::string lamps_against(const PrintPlan& plan, const Machine& machine) {
  if (!plan.lamps_follow()) {
    return "slices are lit and the stack was not made for lamps that follow the stage (--ramp "
           "lamp-follows): slowing down would cure more";
  }
  if (machine.blue.min_share > 0) {
    return fmt::format(
        "slices are lit and the blue lamp can't follow the stage to a stop: it is dark below {:g} "
        "% of its light",
        machine.blue.min_share * 100);
  }
  if (plan.uv &&
      (machine.uv.min_share > 0 || (machine.printer.uv && machine.printer.uv->min_mw_cm2() > 0))) {
    return "slices are lit and the UV lamp can't follow the stage to a stop, so that its ratio to "
           "blue light would change";
  }
  return "";
}

}  // namespace

PausePlace pause_place(const PrintPlan& plan, const Machine& machine, double stage_um,
                       bool dry_run) {
  PausePlace place;
  const double reaction_um = kReactionCycles * machine.limits.cycle_s * plan.speed_um_s;
  const std::string against = dry_run ? "" : lamps_against(plan, machine);
  if (against.empty()) {
    place.stop_um = stage_um + reaction_um + plan.ramp_um;
    place.possible = place.stop_um < plan.end_um;
    if (!place.possible) {
      place.why = fmt::format("the print ends in {:.0f} um, before the stage could stop",
                              plan.end_um - stage_um);
    }
    return place;
  }
  // The stretch of dark slices that is needed for the stage to stop and to reach its speed again,
  // um.
  const double way_um = 2 * plan.ramp_um + reaction_um;
  const int slices = static_cast<int>(plan.frames.size());
  const int present =
      std::max(0, static_cast<int>(std::floor((stage_um - plan.start_um) / plan.layer_um)));
  for (int from = present; from < slices;) {
    if (plan.frames[static_cast<std::size_t>(from)].lit) {
      ++from;
      continue;
    }
    int to = from;
    while (to < slices && !plan.frames[static_cast<std::size_t>(to)].lit) ++to;
    const double dark_um = plan.start_um + from * plan.layer_um;
    const double begin_um = std::max(dark_um, stage_um + reaction_um);
    if (begin_um + way_um <= plan.start_um + to * plan.layer_um) {
      if (dark_um <= stage_um + reaction_um) {
        place.possible = true;
        place.stop_um = begin_um + plan.ramp_um;
        return place;
      }
      place.why = fmt::format("{}; next possible in the dark slices from {} on, at z = {:.3f} mm",
                              against, from, (dark_um - plan.start_um) * 1e-3);
      return place;
    }
    from = to;
  }
  place.why = fmt::format(
      "{}; in the rest of this print no dark slices are {:.0f} um high together, which stopping "
      "and starting takes",
      against, way_um);
  return place;
}

}  // namespace slicecorr::bridge
