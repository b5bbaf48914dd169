// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// How much light each slice got, from what the machine measures on its way.

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "control/state.hpp"

namespace slicecorr::bridge {
namespace {

/// More or less of a slice's light than this share of it is told.
constexpr double kBorneLight = 0.1;

}  // namespace

void Controller::Impl::judge_light() {
  const bool counts = plan.mode == ExposureMode::continuous && !plan.turns() && !dry_run &&
                      phase == Phase::printing && act == Act::move;
  if (!counts) {
    passing.reset();
    return;
  }
  const double at_um = machine.has_encoder() ? status.stage_um : stage.position_um(*status_at_s);
  const double light = std::pow(std::max(0.0, status.blue_measured), plan.m);
  const Passing here{(at_um - frame_um(0)) / plan.layer_um, *status_at_s, light};
  if (!passing) {
    passing = here;
    slice_is_whole = false;
    slice_light = 0;
    return;
  }
  // A stage that is told to be slightly lower than before has not moved.
  const double from = passing->slices, to = std::max(from, here.slices);
  // The answer comes before lamps follow what came with the question: what they gave until then. Over
  // answers that were lost lamps may have followed what was asked meanwhile.
  const double time_s = std::max(0.0, here.at_s - passing->at_s);
  const bool gap = time_s > 1.5 * limits.cycle_s;
  double left = (gap ? (light + passing->light) / 2 : light) * time_s / plan.layer_um;
  double at = from;
  for (double edge = std::floor(from) + 1; edge <= to; ++edge) {
    const double share = left * (edge - at) / (to - at);
    tell_light(static_cast<int>(edge) - 1, slice_light + share);
    left -= share;
    at = edge;
    slice_is_whole = true;
    slice_light = 0;
  }
  slice_light += left;
  passing = Passing{to, here.at_s, light};
}

void Controller::Impl::tell_light(int slice, double light_s_um) {
  if (!slice_is_whole || slice < 0 || slice >= frames) return;
  const double light = light_s_um * plan.light_speed_at(slice);
  if (!plan.frames[static_cast<std::size_t>(slice)].lit) return;
  if (std::abs(light - 1) <= kBorneLight) return;
  ++light_off.slices;
  if (light_off.slice < 0 || std::abs(light - 1) > std::abs(light_off.light - 1)) {
    light_off.slice = slice;
    light_off.light = light;
  }
  event("light off", fmt::format("slice {} got {:.0f} % of its light", slice, light * 100));
}

}  // namespace slicecorr::bridge
