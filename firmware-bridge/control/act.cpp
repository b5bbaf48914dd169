// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// What comes next: lamps, stage and frames, phase by phase.

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "control/state.hpp"
#include "plan/checks.hpp"

namespace slicecorr::bridge {
namespace {

/// A stage that arrives off its target, but within its tolerance, gets this long to come to rest,
/// s.
constexpr double kRestS = 0.2;
/// A vial turns steadily when its speed was within this share of what it was told for so long, s.
constexpr double kSteadyShare = 0.05, kSteadyS = 0.5;

}  // namespace

void Controller::Impl::go() {
  switch (phase) {
    case Phase::connecting:
      return go_connecting();
    case Phase::warming:
      return go_warming();
    case Phase::homing:
      return go_homing();
    case Phase::uv_on:
      return go_uv_on();
    case Phase::printing:
      if (plan.turns() && act < Act::move) return go_spinning();
      return plan.mode == ExposureMode::layerwise ? go_layers() : go_printing();
    case Phase::pausing:
      return go_pausing();
    case Phase::paused:
      return go_paused();
    case Phase::resuming:
      return go_resuming();
    case Phase::blue_off:
      return go_blue_off();
    case Phase::uv_off:
      return go_uv_off();
    case Phase::raising:
      return go_raising();
    case Phase::done:
      return go_done();
    case Phase::lamps_off:
    case Phase::stopping:
    case Phase::blacking:
    case Phase::failed:
      return go_fault();
  }
}

void Controller::Impl::command_move(double target_um, double speed_um_s,
                                    double acceleration_um_s2) {
  begun = true;
  out.command = Command::run;
  out.target_um = target_um;
  out.speed_um_s = speed_um_s;
  out.acceleration_um_s2 = acceleration_um_s2;
  // The motion as registers can express it, because the machine will do that.
  SetPoints told = out;
  if (machine.modbus) told = decode_set_points(*machine.modbus, encode(*machine.modbus, out));
  if (!machine.modbus || !machine.modbus->write.contains(Signal::acceleration_um_s2)) {
    told.acceleration_um_s2 = acceleration_um_s2;
  }
  stands_since_s.reset();
  move = Move{next_sequence, told.target_um, told.speed_um_s, told.acceleration_um_s2};
  const double way = std::abs(told.target_um - stage.position_um(now_s));
  move_limit_s = now_s +
                 1.5 * (way / std::max(told.speed_um_s, 1e-3) +
                        2 * told.speed_um_s / told.acceleration_um_s2) +
                 5;
}

void Controller::Impl::hold() {
  begun = true;
  out.command = Command::run;
  out.target_um = stage.measured_um();
  out.speed_um_s = machine.stage.lift_speed_um_s;
  out.acceleration_um_s2 = machine.stage.acceleration_um_s2;
}

bool Controller::Impl::arrived() const {
  if (move || !stands_since_s) return false;
  // Very near its target the stage has arrived at once; elsewhere within its tolerance only after
  // it has had time to come to rest.
  const double off = std::abs(status.stage_um - stage.commanded().target_um());
  const double near_um = std::max(1.0, machine.stage.tolerance_um / 4);
  return off <= near_um || (off <= machine.stage.tolerance_um && now_s - *stands_since_s >= kRestS);
}

double Controller::Impl::speed_to_tell() {
  if (plan.slice_speed_um_s.empty()) return plan.speed_um_s;
  const double at_um = stage.position_um(now_s), a = plan.acceleration_um_s2;
  const double v = std::max(0.0, stage.speed_um_s(now_s));
  const double reaction_um = v * kReactionCycles * limits.cycle_s;
  const double rounding_um = 1e-6;
  const int here =
      static_cast<int>(std::floor((at_um - frame_um(0) + rounding_um) / plan.layer_um));
  double told = plan.speed_at(here);
  for (int n = std::max(here, -1) + 1; n < frames; ++n) {
    const double left_um = frame_um(n) - at_um, slower = plan.speed_at(n);
    if (left_um > reaction_um + v * v / (2 * a)) break;
    if (slower >= told || left_um > reaction_um + std::max(0.0, v * v - slower * slower) / (2 * a))
      continue;
    told = slow_um_s = slower;
    slow_until_um = frame_um(n);
  }
  // What it has begun to brake for holds until it is there.
  return at_um + rounding_um < slow_until_um ? std::min(told, slow_um_s) : told;
}

void Controller::Impl::follow_speeds() {
  if (plan.slice_speed_um_s.empty() || move) return;
  const double speed_um_s = speed_to_tell();
  if (speed_um_s == out.speed_um_s) return;
  command_move(out.target_um, speed_um_s, plan.acceleration_um_s2);
  move->new_speed = true;
  move->at_s = now_s;
}

void Controller::Impl::show(int number, double planned_um, double light_at_s) {
  light_at_s = std::max(light_at_s, now_s + latency_s());
  show_blue(number, planned_um, light_at_s);
  if (has_uv_display()) show_uv(number, planned_um, light_at_s);
}

void Controller::Impl::show_blue(int number, double planned_um, double light_at_s) {
  light_at_s = std::max(light_at_s, now_s + limits.display_latency_s);
  step.show = number;
  step.show_at_s = light_at_s - limits.display_latency_s;
  pending = Pending{number, planned_um, light_at_s};
}

void Controller::Impl::show_uv(int number, double planned_um, double light_at_s) {
  const double latency_s = machine.uv_display->latency_s;
  light_at_s = std::max(light_at_s, now_s + latency_s);
  step.show_uv = number;
  step.show_uv_at_s = light_at_s - latency_s;
  uv_pending = Pending{number, planned_um, light_at_s};
}

double Controller::Impl::uv_of(int number) const {
  if (!plan.uv || frames == 0) return 0;
  return plan.frames[static_cast<std::size_t>(std::clamp(number, 0, frames - 1))].uv_mw_cm2;
}

bool Controller::Impl::uv_settled() const {
  if (!plan.uv || dry_run) return true;
  const double asked = uv_share(out.uv_mw_cm2);
  return uv.settled_at(asked, uv_share(status.uv_measured.value_or(0)), status_at_s.value_or(0));
}
bool Controller::Impl::blue_settled() const {
  return dry_run || blue.settled_at(out.blue_share, status.blue_measured, status_at_s.value_or(0));
}
bool Controller::Impl::blue_dark() const {
  return blue.settled_at(0, status.blue_measured, status_at_s.value_or(0));
}
bool Controller::Impl::uv_dark() const {
  return !machine.printer.uv || !status.uv_measured ||
         uv.settled_at(0, uv_share(*status.uv_measured), status_at_s.value_or(0));
}

void Controller::Impl::lamp_limit(double limit_s, const char* what) {
  if (in_act_s() > limit_s) fail(Fault::lamp_mismatch, what);
}
bool Controller::Impl::uv_came() {
  if (uv_settled()) return true;
  lamp_limit(machine.uv.warm_up_s + 5 * machine.uv.settle_s + 1,
             "the UV lamp does not come to its light");
  return false;
}
bool Controller::Impl::blue_came() {
  if (blue_settled()) return true;
  lamp_limit(machine.blue.warm_up_s + 5 * machine.blue.settle_s + 1,
             "the blue lamp does not come to its light");
  return false;
}
bool Controller::Impl::uv_went() {
  if (uv_dark()) return true;
  lamp_limit(5 * machine.uv.settle_s + 2, "the UV lamp does not go off");
  return false;
}
bool Controller::Impl::blue_went() {
  if (blue_dark()) return true;
  lamp_limit(5 * machine.blue.settle_s + 2, "the blue lamp does not go off");
  return false;
}

void Controller::Impl::go_connecting() {
  out.command = Command::off;
  out.blue_share = out.uv_mw_cm2 = 0;
  if (act == Act::begin) {
    if (!connected) return;
    turn_to(Act::settle);
    event("connected");
  }
  if (act == Act::settle) {
    const bool idle = status.state == MachineState::idle;
    if (idle && blue_dark() && uv_dark()) {
      out.target_um = stage.measured_um();
      show(kBlackFrame, 0, now_s);
      return turn_to(Act::show_first);
    }
    if (in_act_s() > 2) {
      if (!idle) return fail(Fault::machine_restarted, "the machine goes on running");
      fail(Fault::lamp_mismatch, "a lamp shines that is off");
    }
    return;
  }
  if (!displayed(kBlackFrame)) return;
  lamps_judged = true;
  const bool warm = !dry_run && ((machine.blue.warm_up_s > 0 && !plan.turns()) ||
                                 (plan.uv && machine.uv.warm_up_s > 0));
  enter(warm ? Phase::warming : Phase::homing);
  go();
}

void Controller::Impl::go_warming() {
  // A vial must not stand in the light of black: its lamp warms up while it turns.
  const double blue_s = plan.turns() ? 0 : machine.blue.warm_up_s,
               uv_s = plan.uv ? machine.uv.warm_up_s : 0;
  rising = true;
  switch (act) {
    case Act::begin:
      hold();
      // UV light first, and it stays on until the print is over: it does not cure.
      out.uv_mw_cm2 = uv_of(0);
      return turn_to(Act::uv_warm);
    case Act::uv_warm:
      if (plan.uv && (in_act_s() < uv_s || !uv_settled())) {
        return lamp_limit(uv_s + 5 * machine.uv.settle_s + 2, "the UV lamp does not warm up");
      }
      if (blue_s <= 0) break;
      out.blue_share = 1;
      return turn_to(Act::blue_warm);
    case Act::blue_warm:
      if (in_act_s() < blue_s || !blue_settled()) {
        return lamp_limit(blue_s + 5 * machine.blue.settle_s + 2, "the blue lamp does not warm up");
      }
      out.blue_share = 0;
      return turn_to(Act::blue_dark);
    default:
      if (!blue_went()) return;
      break;
  }
  rising = false;
  enter(Phase::homing);
  go();
}

void Controller::Impl::go_homing() {
  if (act == Act::begin) {
    command_move(machine.stage.home_um, machine.stage.lift_speed_um_s,
                 machine.stage.acceleration_um_s2);
    return turn_to(Act::arrive);
  }
  if (!arrived()) return;
  move_limit_s = 0;
  enter(Phase::uv_on);
  go();
}

void Controller::Impl::go_uv_on() {
  if (act == Act::begin) {
    out.uv_mw_cm2 = uv_of(next_frame);
    rising = true;
    turn_to(Act::uv_settle);
  }
  if (!uv_came()) return;
  rising = false;
  enter(Phase::printing, dry_run ? "without light" : "");
  go();
}

double Controller::Impl::print_target_um() const {
  if (plan.lamps_follow()) return plan.end_um;
  if (plan.turns()) {
    // It comes to rest at a whole turn.
    const double turn_um = machine.stage.turn_um();
    const double least = end_um() + plan.ramp_um + 4 * limits.cycle_s * plan.speed_um_s;
    return std::ceil(least / turn_um) * turn_um;
  }
  // Beyond the print's end by the ramp, and by the way in which the lamp goes off before the ramp.
  const double target = plan.end_um + plan.ramp_um + 4 * limits.cycle_s * plan.speed_um_s;
  return machine.stage.travel_um > 0 ? std::min(target, machine.stage.travel_um) : target;
}

void Controller::Impl::go_spinning() {
  if (act == Act::begin) {
    stage.start(status.stage_um, status_at_s.value_or(0));
    command_move(print_target_um(), plan.speed_um_s, plan.acceleration_um_s2);
    slipped_um = 0;
    slipped_at_s = now_s;
    unsteady_at_s = now_s;
    return turn_to(Act::spin);
  }
  const double speed = status.stage_speed_um_s.value_or(stage.speed_um_s(now_s));
  if (move || std::abs(speed - plan.speed_um_s) > kSteadyShare * plan.speed_um_s) {
    unsteady_at_s = now_s;
  }
  // Two cycles before it must be handed over, the first frame is planned as all others are.
  const double first_um = frame_um(0) - 4 * limits.cycle_s * plan.speed_um_s;
  const double at_um = stage.position_um(now_s);
  if (act == Act::spin) {
    if (at_um < first_um - plan.lamp_lead_um) return;
    if (now_s - *unsteady_at_s < kSteadyS) {
      if (put_off_um >= kMostPutOff * machine.stage.turn_um()) {
        return fail(Fault::stage_error,
                    fmt::format("the stage does not turn steadily: it goes {:.2f} °/s, told {:.2f} "
                                "°/s",
                                speed / plan.um_per_deg, plan.speed_um_s / plan.um_per_deg));
      }
      put_off_um += machine.stage.turn_um();
      event("put off", "by a turn: the stage does not turn steadily yet");
      command_move(print_target_um(), plan.speed_um_s, plan.acceleration_um_s2);
      return;
    }
    out.blue_share = 1;  // while the display shows black
    rising = true;
    return turn_to(Act::spin_lit);
  }
  if (at_um < first_um) return;
  if (!blue_settled()) {
    return fail(Fault::lamp_mismatch, "the blue lamp does not come to its light");
  }
  rising = false;
  turn_to(Act::move);
  go_printing();
}

void Controller::Impl::go_printing() {
  switch (act) {
    case Act::begin:
      if (plan.lamps_follow()) {
        show(0, plan.start_um, now_s);  // the lamp is still dark: it begins with the stage
        return turn_to(Act::show_first);
      }
      // While the display shows black.
      out.blue_share = lamp_share(plan, machine.blue, plan.speed_at(0), 0);
      rising = true;
      return turn_to(Act::blue_settle);
    case Act::blue_settle:
      if (!blue_came()) return;
      break;
    case Act::show_first:
      if (!displayed(0)) return;
      next_frame = 1;
      break;
    default: {
      follow_speeds();
      plan_next_frame();
      follow();
      if (pause_wanted) return enter(Phase::pausing);
      const bool ended =
          plan.lamps_follow() ? arrived() : next_frame > frames && blue_displayed(kBlackFrame);
      if (!ended) return;
      if (next_frame < frames) {
        return fail(Fault::defect, fmt::format("the print ended before frame {}", next_frame));
      }
      move_limit_s = 0;
      enter(Phase::blue_off);
      return go();
    }
  }
  rising = false;
  stage.start(status.stage_um, status_at_s.value_or(0));
  command_move(print_target_um(), speed_to_tell(), plan.acceleration_um_s2);
  turn_to(Act::move);
  follow();
}

void Controller::Impl::plan_next_frame() {
  if (any_pending()) return;
  const bool last = next_frame == frames;
  if (next_frame > frames || (last && plan.lamps_follow())) return;
  const int number = last ? kBlackFrame : next_frame;
  const double planned = last ? end_um() : frame_um(number);
  // The frame is sent to the display in this cycle if it is due before the next cycle but one.
  double early = now_s + latency_s();
  double late = early + 2 * limits.cycle_s;
  if (stage.position_um(late) < planned) return;
  if (stage.position_um(early) < planned) {
    for (int i = 0; i < 40; ++i) {
      const double middle = (early + late) / 2;
      (stage.position_um(middle) < planned ? early : late) = middle;
    }
  } else {
    late = early;
  }
  if (last) {
    // UV light stays until blue light is off.
    show_blue(number, planned, late);
  } else {
    show(number, planned, late);
  }
  ++next_frame;
}

void Controller::Impl::follow() {
  const auto share_at = [&](double at_s) {
    // A new speed that was told counts as taken over, also while the answer is not there, because the
    // machine that gets it gets the lamps' light with it.
    std::optional<StageEstimate> changed;
    if (move && move->new_speed) {
      changed = stage;
      changed->change_speed(move->speed_um_s, move->acceleration_um_s2, move->at_s);
    }
    const StageEstimate& then = changed ? *changed : stage;
    const int slice =
        static_cast<int>(std::floor((then.position_um(at_s) - frame_um(0)) / plan.layer_um));
    return lamp_share(plan, machine.blue, std::max(0.0, then.speed_um_s(at_s)), slice);
  };
  const bool run_up = !plan.lamps_follow() && phase == Phase::printing && frame < 0 &&
                      next_frame <= 1 && stage.position_um(now_s) < frame_um(0);
  // Half a cycle ahead: the middle of the time for which the set-point holds.
  const double first_share = lamp_share(plan, machine.blue, plan.speed_at(0), 0);
  const double share = run_up ? first_share : share_at(now_s + limits.cycle_s / 2);
  out.blue_share = share;
  if (!plan.uv) return;
  // UV light follows blue light, so that the dose stays the same: it rises earlier and falls later,
  // so that resin at the window never cures.
  shares.push_back({now_s, share});
  while (shares.size() > 1 &&
         shares.front().at_s < now_s - machine.blue.settle_s - limits.cycle_s) {
    shares.pop_front();
  }
  // While blue is dark UV light stays as it is: it is on before blue, and goes off after it.
  if (share <= 0) return;
  double uv_follows = run_up ? first_share : share_at(now_s + 2 * limits.cycle_s);
  for (const AskedLight& s : shares) uv_follows = std::max(uv_follows, s.share);
  double level = uv_of(frame < 0 ? 0 : frame);
  if (pending && pending->number >= 0) {
    const auto next = static_cast<std::size_t>(pending->number);
    if (plan.frames[next].least_uv_mw_cm2 > level) level = plan.frames[next].uv_mw_cm2;
  }
  out.uv_mw_cm2 = std::min(level * uv_follows, plan.uv_max_mw_cm2);
  if (uv_share(out.uv_mw_cm2) < machine.uv.min_share && level > 0) {
    out.uv_mw_cm2 = 0;
    out.blue_share = 0;
  }
}

void Controller::Impl::go_pausing() {
  switch (act) {
    case Act::begin:
      if (plan.mode == ExposureMode::layerwise) {
        turn_to(Act::blue_dark);
        return go_pausing();
      }
      command_move(stop_um, speed_to_tell(), plan.acceleration_um_s2);
      turn_to(Act::arrive);
      [[fallthrough]];
    case Act::arrive:
      follow_speeds();
      plan_next_frame();
      follow();
      if (any_pending() || !arrived()) return;
      move_limit_s = 0;
      turn_to(Act::blue_dark);
      [[fallthrough]];
    case Act::blue_dark:
      out.blue_share = 0;
      if (!blue_went()) return;
      out.uv_mw_cm2 = 0;
      return turn_to(Act::uv_dark);
    case Act::uv_dark:
      if (!uv_went()) return;
      paused_frame = frame;
      show(kBlackFrame, 0, now_s);
      return turn_to(Act::show);
    default:
      if (!displayed(kBlackFrame)) return;
      pause_wanted = resume_wanted = false;
      return enter(Phase::paused);
  }
}

void Controller::Impl::go_paused() {
  if (resume_wanted) {
    resume_wanted = false;
    enter(Phase::resuming);
    go_resuming();
  }
}

void Controller::Impl::go_resuming() {
  switch (act) {
    case Act::begin:
      out.uv_mw_cm2 = uv_of(std::max(paused_frame, 0));
      rising = true;
      return turn_to(Act::uv_settle);
    case Act::uv_settle:
      if (!uv_came()) return;
      rising = false;
      if (plan.mode == ExposureMode::layerwise) {
        enter(Phase::printing);
        return go();
      }
      show(paused_frame, stage.measured_um(), now_s);
      return turn_to(Act::show);
    default:
      if (!displayed(paused_frame)) return;
      enter(Phase::printing);
      stage.start(status.stage_um, status_at_s.value_or(0));
      command_move(print_target_um(), speed_to_tell(), plan.acceleration_um_s2);
      turn_to(Act::move);
      follow();
  }
}

void Controller::Impl::go_blue_off() {
  out.blue_share = 0;
  if (act == Act::begin) turn_to(Act::blue_dark);
  if (!blue_went()) return;
  enter(Phase::uv_off);
  go();
}

void Controller::Impl::go_uv_off() {
  if (act == Act::begin) {
    out.uv_mw_cm2 = 0;
    return turn_to(Act::uv_dark);
  }
  if (act == Act::uv_dark) {
    if (!uv_went()) return;
    if (!blue_displayed(kBlackFrame) && !pending) show_blue(kBlackFrame, 0, now_s);
    if (!uv_displayed(kBlackFrame) && !uv_pending) show_uv(kBlackFrame, 0, now_s);
    return turn_to(Act::show);
  }
  if (!displayed(kBlackFrame)) return;
  enter(Phase::raising);
  go();
}

void Controller::Impl::go_raising() {
  // A vial goes on to the whole turn that it was sent to, and stands.
  if (act == Act::begin && plan.turns()) return turn_to(Act::arrive);
  if (act == Act::begin) {
    const double top = machine.stage.travel_um;
    if (top <= stage.measured_um() + machine.stage.tolerance_um) return enter(Phase::done);
    command_move(top, machine.stage.lift_speed_um_s, machine.stage.acceleration_um_s2);
    return turn_to(Act::arrive);
  }
  if (!arrived()) return;
  move_limit_s = 0;
  enter(Phase::done);
  go();
}

void Controller::Impl::go_done() {
  out.command = Command::off;
  // Waits for the machine's answer, for two tries at most: everything is dark and stands already.
  if (act == Act::begin) {
    tries = 1;
    return turn_to(Act::finish);
  }
  if (answered || ++tries > 2) step.finished = true;
}

}  // namespace slicecorr::bridge
