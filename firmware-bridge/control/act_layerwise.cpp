// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Layer by layer: lift, lower, rest, light, expose.

#include <algorithm>
#include <cmath>
#include <optional>

#include "control/state.hpp"

namespace slicecorr::bridge {

void Controller::Impl::begin_layer(int n) {
  if (n >= frames) {
    enter(Phase::blue_off);
    return go();
  }
  if (pause_wanted) {
    enter(Phase::pausing);
    return go();
  }
  // The part comes off the window before it goes to its next place; the platform has none.
  const bool lift = n > 0 && machine.stage.lift_um > 0;
  const double top = std::min(plan.frame_um(n - 1) + machine.stage.lift_um,
                              machine.stage.travel_um > 0 ? machine.stage.travel_um : 1e300);
  command_move(lift ? std::max(top, plan.frame_um(n)) : plan.frame_um(n),
               machine.stage.lift_speed_um_s, machine.stage.acceleration_um_s2);
  return turn_to(lift ? Act::move : Act::arrive);
}

void Controller::Impl::expose_layer(int n) {
  const bool lit = std::abs(status.blue_measured - out.blue_share) <= machine.blue.tolerance;
  if (rising && (dry_run || lit)) rising = false;
  const double until_s = shown_at_s + plan.frames[static_cast<std::size_t>(n)].exposure_s;
  if (frame == n) {
    if (!pending && until_s <= now_s + limits.display_latency_s + 2 * limits.cycle_s) {
      show_blue(kBlackFrame, plan.frame_um(n), until_s);
    }
    return;
  }
  if (rising) return fail(Fault::lamp_mismatch, "the blue lamp did not come to its light");
  out.blue_share = 0;
  return turn_to(Act::blue_dark);
}

void Controller::Impl::go_layers() {
  const int n = next_frame;
  // Black pixels give light, too. So the image is shown before the lamp is lit: the lamp begins the
  // exposure, and the display ends it with black. Lamps that warm up slowly are lit before the
  // image.
  const bool lamp_first = machine.blue.warm_up_s > 0;
  switch (act) {
    case Act::begin:
      return begin_layer(n);
    case Act::move:
      if (!arrived()) return;
      command_move(plan.frame_um(n), machine.stage.return_speed_um_s,
                   machine.stage.acceleration_um_s2);
      return turn_to(Act::arrive);
    case Act::arrive:
      if (!arrived()) return;
      move_limit_s = 0;
      return turn_to(Act::settle);
    case Act::settle:
      if (in_act_s() < machine.stage.settle_s) return;
      out.uv_mw_cm2 = uv_of(n);
      rising = true;
      return turn_to(Act::uv_settle);
    case Act::uv_settle:
      if (!uv_came()) return;
      if (!lamp_first) {
        show(n, plan.frame_um(n), now_s);
        return turn_to(Act::show);
      }
      out.blue_share = 1;
      return turn_to(Act::blue_settle);
    case Act::blue_settle:
      if (!blue_came()) return;
      rising = false;
      show(n, plan.frame_um(n), now_s + limits.cycle_s + latency_s());
      return turn_to(Act::show);
    case Act::show:
      if (!displayed(n)) return;
      if (lamp_first) {
        turn_to(Act::expose);
        return go_layers();
      }
      out.blue_share = 1;
      return turn_to(Act::light);
    case Act::light: {
      // The exposure begins when the machine has answered that it took the lamp's set-point over.
      const auto lit_s = dry_run ? std::optional(now_s) : blue.confirmed_at_s();
      if (!lit_s) return;
      shown_at_s = *lit_s + machine.blue.settle_s / std::log(100.0);
      turn_to(Act::expose);
      [[fallthrough]];
    }
    case Act::expose:
      return expose_layer(n);
    default:
      if (!blue_went()) return;
      ++next_frame;
      turn_to(Act::begin);
      return go_layers();
  }
}

}  // namespace slicecorr::bridge
