// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// What comes after a fault: lamps off, stage stopped, black, in this order.

#include <algorithm>

#include "control/state.hpp"

namespace slicecorr::bridge {

void Controller::Impl::go_fault() {
  out.blue_share = out.uv_mw_cm2 = 0;
  if (phase == Phase::lamps_off) {
    if (act == Act::begin) {
      // The stage is not stopped yet: it would stand before the lamps are off.
      fault_at_s = now_s;
      lamps_taken = stop_taken = false;
      tries = 1;
      event("lamps off", "asked");
      return turn_to(Act::finish);
    }
    // Where the machine does not answer, waits until its own watchdog, which gets no heartbeat, has
    // had time to put the lamps off.
    ++tries;
    if (!lamps_taken && (tries <= 2 || in_act_s() < limits.watchdog_s)) return;
    event("lamps off", lamps_taken ? "answered" : "not answered");
    enter(Phase::stopping);
    return go_fault();
  }
  if (phase == Phase::stopping) {
    out.command = Command::stop;
    if (act == Act::begin) {
      tries = 1;
      event("stage stop", "asked");
      return turn_to(Act::finish);
    }
    if (!stop_taken && tries++ < 2) return;
    event("stage stop", stop_taken ? "answered" : "not answered");
    enter(Phase::blacking);
    return go_fault();
  }
  if (phase == Phase::blacking) {
    if (act == Act::begin) {
      pending.reset();
      uv_pending.reset();
      step.show = kBlackFrame;
      step.show_at_s = now_s;
      event("black", "asked");
      return turn_to(Act::finish);
    }
    if (act == Act::finish) {
      if (!black_shown && in_act_s() < 1) return;
      event("black", black_shown ? "shown" : "not answered");
      if (has_uv_display()) {
        // After blue: as long as anything of it is left, it is to be kept off the window.
        step.show_uv = kBlackFrame;
        step.show_uv_at_s = now_s;
        event("UV black", "asked");
        return turn_to(Act::uv_dark);
      }
    } else {
      if (!uv_black_shown && in_act_s() < 1) return;
      event("UV black", uv_black_shown ? "shown" : "not answered");
    }
    enter(Phase::failed, fault_detail);
    return go_fault();
  }
  // Lamps off and stop are asked for again, until the machine's own watchdog must long have acted.
  const double since_s = now_s - fault_at_s;
  if ((!lamps_taken || !stop_taken) && since_s <= 2 * limits.watchdog_s) return;
  // Waits until lamps have had their time to go dark.
  const bool bright = begun && !(heard_since() && measured_dark());
  if (bright && (lamps_taken || heard_since()) &&
      since_s < 1 + machine.blue.settle_s + machine.uv.settle_s) {
    return;
  }
  // A vial that was at speed takes a while to come to rest.
  const bool moves = begun && heard_since() && !measured_still();
  const double braking_s = machine.stage.max_speed_um_s / machine.stage.acceleration_um_s2;
  if (moves && since_s < 1 + braking_s) return;
  if (bright && heard_since()) event("light", "A LAMP STILL SHINES");
  step.finished = true;
}

}  // namespace slicecorr::bridge
