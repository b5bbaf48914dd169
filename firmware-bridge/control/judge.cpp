// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// What the machine and the display say, judged.

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "control/state.hpp"

namespace slicecorr::bridge {
namespace {

/// Longest wait for the first answer of a machine, s.
constexpr double kConnectS = 5;
/// After its commanded motion has ended the stage must have arrived within this time, s.
constexpr double kLateArrivalS = 2;
/// Below this share of its speed a vial counts as stalled.
constexpr double kStalled = 0.1;

/// Two figures as texts, with so many digits that they differ.
std::pair<std::string, std::string> told_apart(double a, double b) {
  for (int digits = 3; digits < 17; ++digits) {
    auto one = fmt::format("{:.{}g}", a, digits), other = fmt::format("{:.{}g}", b, digits);
    if (one != other) return {one, other};
  }
  return {fmt::format("{:g}", a), fmt::format("{:g}", b)};
}

}  // namespace

void Controller::Impl::take(const Answer& answer) {
  status = answer.status;
  status_at_s = answer.at_s;
  if (answer.only_read) return;
  last_answer_s = answer.at_s;
  const bool known = connected;
  check_sequence(answer);
  if (!known) stage.start(status.stage_um, answer.at_s);
  if (!machine.has_encoder()) status.stage_um = stage.commanded().at(answer.at_s).position_um();
  if (!failing()) check_measured();
  if (!connected) return;
  const double* const speed = status.stage_speed_um_s ? &*status.stage_speed_um_s : nullptr;
  stage.measure(status.stage_um, speed, answer.at_s, answer.within_s);
  if (move || !stage.commanded().at(now_s).arrived()) {
    stands_since_s.reset();
  } else if (!stands_since_s) {
    stands_since_s = now_s;
  }
  if (failing()) return;
  check_interlocks();
  check_state();
  check_stage();
  check_lamps();
  judge_light();
}

void Controller::Impl::check_sequence(const Answer& answer) {
  const std::uint16_t echo = answer.status.sequence_echo;
  const auto found =
      std::find_if(sent.rbegin(), sent.rend(), [&](const Sent& s) { return s.sequence == echo; });
  if (found == sent.rend()) {
    if (connected && !failing()) {
      fail(Fault::machine_restarted,
           fmt::format("it answers to set-points {} that were not sent", echo));
    }
    return;
  }
  connected = true;
  blue.confirmed(found->count, answer.at_s);
  uv.confirmed(found->count, answer.at_s);
  if (found->phase >= Phase::lamps_off) lamps_taken = true;
  if (found->phase >= Phase::stopping) stop_taken = true;
  const double age_s = answer.at_s - found->at_s;
  if (age_s > limits.heartbeat_timeout_s && !failing()) {
    fail(Fault::machine_restarted,
         fmt::format("it has not taken over set-points for {:.0f} ms", age_s * 1e3));
  }
  // The commanded motion begins when the machine has taken it over.
  if (move) {
    const auto moved = std::find_if(sent.begin(), sent.end(),
                                    [&](const Sent& s) { return s.sequence == move->sequence; });
    if (moved != sent.end() && moved <= found.base() - 1) {
      // That was some time between sending it and this answer, since earlier answers may have been
      // lost.
      const double last_s = answer.at_s + answer.within_s;
      move_within_s = std::max(0.0, last_s - moved->at_s) / 2;
      if (move->new_speed) {
        stage.change_speed(move->speed_um_s, move->acceleration_um_s2, last_s - move_within_s);
      } else {
        stage.command(move->target_um, move->speed_um_s, move->acceleration_um_s2,
                      last_s - move_within_s);
      }
      move.reset();
    }
  }
}

void Controller::Impl::written_alone(bool lamps, bool command) {
  if (lamps) {
    lamps_taken = true;
    blue.confirmed(sent_count, now_s);
    uv.confirmed(sent_count, now_s);
  }
  if (command) stop_taken = true;
}

void Controller::Impl::check_measured() {
  if (const auto wrong = impossible(machine, status); !wrong.empty()) {
    fail(Fault::impossible_measurement, wrong);
  }
}

void Controller::Impl::check_interlocks() {
  if (status.stop_pressed) return fail(Fault::stop_pressed, "the stop button is pressed");
  if (status.door_open) return fail(Fault::door_open, "a door or cover is open");
  if (status.over_temperature) {
    return fail(Fault::over_temperature, "the machine says that it is too hot");
  }
  if (status.temperature_c && *status.temperature_c > limits.max_temperature_c) {
    return fail(Fault::over_temperature,
                fmt::format("{:.1f} °C, at most {:g} °C is allowed", *status.temperature_c,
                            limits.max_temperature_c));
  }
  if (status.lamp_failed) return fail(Fault::lamp_failed, "the machine says that a lamp failed");
  if (status.stage_failed) {
    return fail(Fault::stage_failed, "the machine says that its stage failed");
  }
  if (status.watchdog_tripped) {
    return fail(Fault::watchdog_tripped, "the machine's own watchdog switched it off");
  }
}

void Controller::Impl::check_state() {
  const auto state = status.state;
  if (phase == Phase::connecting || phase == Phase::done) {
    if (phase == Phase::connecting &&
        (state == MachineState::fault || state == MachineState::stopped)) {
      fail(Fault::machine_restarted,
           fmt::format("the machine is {}: see why, then `printbridge reset`",
                       state == MachineState::fault ? "in a fault of its own" : "stopped"));
    }
    return;
  }
  if (state == MachineState::running) {
    not_running_since_s.reset();
    seen_running = true;
    return;
  }
  if (!not_running_since_s) not_running_since_s = status_at_s;
  const bool at_once = state != MachineState::idle || seen_running;
  // A machine that was idle may take the command to run over with the next exchange only.
  if (at_once || *status_at_s - *not_running_since_s > limits.heartbeat_timeout_s) {
    fail(Fault::machine_restarted, fmt::format("the machine is {}, expected running",
                                               state == MachineState::fault     ? "in a fault"
                                               : state == MachineState::stopped ? "stopped"
                                                                                : "idle"));
  }
}

void Controller::Impl::check_stage() {
  if (phase == Phase::connecting || phase == Phase::done || move) return;
  if (!machine.has_encoder()) check_slip();
  const double off_um = machine.has_encoder() ? stage.error_um() : slipped_um;
  const double error = std::abs(off_um);
  worst_stage_error_um = std::max(worst_stage_error_um, error);
  // Allows the way of two cycles, since it is not known better when a command was taken over.
  const double speed_um_s =
      machine.has_encoder() ? std::abs(stage.commanded().speed_um_s()) : slip_speed_um_s;
  const double allowed =
      machine.stage.tolerance_um + (2 * limits.cycle_s + move_within_s) * speed_um_s;
  if (error > allowed) {
    const double told_um_s = stage.commanded().speed_um_s();
    const bool stalled = plan.turns() && told_um_s != 0 && status.stage_speed_um_s &&
                         *status.stage_speed_um_s / told_um_s < kStalled;
    const double at_um = machine.has_encoder() ? status.stage_um : status.stage_um + slipped_um;
    fail(Fault::stage_error,
         fmt::format("the stage {} {}, expected {} within {}", stalled ? "has stalled at" : "is at",
                     plan.place(at_um), plan.place(at_um - off_um), plan.place(allowed)));
  }
  const bool forward = plan.mode == ExposureMode::continuous &&
                       (phase == Phase::printing || phase == Phase::pausing) && act >= Act::move;
  if (!forward) {
    highest_um = status.stage_um;
    return;
  }
  const double noise = std::max(1.0, machine.stage.tolerance_um / 4);
  if (status.stage_um < highest_um - noise) {
    fail(Fault::stage_error, fmt::format("the stage went back from {} to {}",
                                         plan.place(highest_um), plan.place(status.stage_um)));
  }
  highest_um = std::max(highest_um, status.stage_um);
}

void Controller::Impl::check_slip() {
  const CommandedMotion commanded = stage.commanded().at(*status_at_s);
  const double dt = std::max(0.0, *status_at_s - slipped_at_s);
  slipped_at_s = *status_at_s;
  slipped_um += (status.stage_speed_um_s.value_or(0) - commanded.speed_um_s()) * dt;
  slipped_um -= slipped_um * std::min(1.0, dt / forgetting_s);
  // A stage that brakes some cycles later than commanded seems to slip by their way, until that is
  // forgotten.
  slip_speed_um_s -= slip_speed_um_s * std::min(1.0, dt / forgetting_s);
  slip_speed_um_s = std::max(slip_speed_um_s, std::abs(commanded.speed_um_s()));
}

void Controller::Impl::check_lamps() {
  if (!lamps_judged) return;
  if (const auto wrong = blue.judge(status.blue_measured, *status_at_s, rising)) {
    return fail(Fault::lamp_mismatch, "the blue lamp " + *wrong);
  }
  if (machine.printer.uv && status.uv_measured) {
    if (const auto wrong = uv.judge(uv_share(*status.uv_measured), *status_at_s, rising)) {
      return fail(Fault::lamp_mismatch, "the UV lamp " + *wrong);
    }
  }
  if (!plan.uv || dry_run || frame < 0) {
    uv_short_since_s.reset();
    return;
  }
  const double least =
      plan.frames[static_cast<std::size_t>(frame)].least_uv_mw_cm2 * status.blue_measured;
  const double measured = status.uv_measured.value_or(0);
  if (measured >= least || status.blue_measured <= machine.blue.tolerance) {
    uv_short_since_s.reset();
    return;
  }
  if (!uv_short_since_s) uv_short_since_s = status_at_s;
  // While lamps settle, one may be ahead of the other: too little UV light is borne for so long, s.
  const double borne = std::max(machine.blue.settle_s, machine.uv.settle_s) + 2 * limits.cycle_s;
  if (*status_at_s - *uv_short_since_s > borne) {
    const auto [has, needs] = told_apart(measured, least);
    fail(Fault::uv_ratio,
         fmt::format("{} mW/cm² of UV light under frame {}, which needs {}", has, frame, needs));
  }
}

void Controller::Impl::take_reports() {
  for (const FrameReport& report : reports) judge_frame(report);
  reports.clear();
}

void Controller::Impl::judge_frame(const FrameReport& report) {
  if (report.on_uv_display && !report.missing) return judge_uv_frame(report);
  if (report.missing) {
    pending.reset();
    uv_pending.reset();
    return fail(Fault::underrun, fmt::format("frame {} was not decoded in time", report.number));
  }
  if (failing()) {
    if (report.number < 0) {
      black_shown = true;
      frame = kBlackFrame;
    }
    return;
  }
  if (!pending || pending->number != report.number) {
    return fail(Fault::wrong_frame,
                fmt::format("frame {} was shown, which was not asked for", report.number));
  }
  const Pending asked = *pending;
  pending.reset();
  const double light_at_s = report.shown_at_s + limits.display_latency_s;
  const double at_um = stage.position_um(light_at_s);
  const Punctuality p = punctuality(report, asked, light_at_s, at_um);
  if (exposing && plan.turns()) end_showing(light_at_s, at_um);
  if (exposing && report.number < 0) end_exposure(light_at_s, p.late());
  if (report.number >= 0) frame = report.number;
  if (p.late()) tell_late("frame", report.number, p);
  frame = report.number;
  shown_at_s = light_at_s;
  if (frame >= frames_shown) {
    frames_shown = frame + 1;
    record_frame(report, asked, at_um, p.late());
  }
}

void Controller::Impl::judge_uv_frame(const FrameReport& report) {
  if (failing()) {
    if (report.number < 0) {
      uv_black_shown = true;
      uv_frame = kBlackFrame;
    }
    return;
  }
  if (!uv_pending || uv_pending->number != report.number) {
    return fail(Fault::wrong_frame,
                fmt::format("UV frame {} was shown, which was not asked for", report.number));
  }
  const Pending asked = *uv_pending;
  uv_pending.reset();
  const double light_at_s = report.shown_at_s + machine.uv_display->latency_s;
  const double at_um = stage.position_um(light_at_s);
  const Punctuality p = punctuality(report, asked, light_at_s, at_um);
  if (p.late()) tell_late("UV frame", report.number, p);
  uv_frame = report.number;
  if (uv_frame < 0) return;
  uv_shown = UvShown{uv_frame, light_at_s, at_um};
  complete_row();
}

void Controller::Impl::complete_row() {
  std::optional<FrameRecord>& row = half_shown ? half_shown : exposing;
  if (!row || !uv_shown || row->frame != uv_shown->number) return;
  row->uv_shown_s = uv_shown->at_s;
  row->uv_stage_um = uv_shown->at_um;
  if (half_shown) step.records.push_back(*std::exchange(half_shown, {}));
}

Controller::Impl::Punctuality Controller::Impl::punctuality(const FrameReport& report,
                                                            const Pending& asked, double light_at_s,
                                                            double at_um) {
  const bool moving = plan.mode == ExposureMode::continuous &&
                      (phase == Phase::printing || phase == Phase::pausing) &&
                      (act == Act::move || act == Act::arrive);
  // Too early is as wrong as too late.
  if (moving) {
    const double late_um = at_um - asked.planned_um;
    worst_late_um = std::max(worst_late_um, late_um);
    const double borne_um = plan.max_late_um(limits);
    if (plan.turns()) {
      return {std::abs(late_um) / plan.um_per_deg, borne_um / plan.um_per_deg, "°", late_um < 0};
    }
    return {std::abs(late_um), borne_um, "um", late_um < 0};
  }
  if (plan.mode == ExposureMode::layerwise && phase == Phase::printing && act == Act::expose &&
      report.number < 0) {
    // What counts here is for how long the layer was exposed.
    const double late_ms = (light_at_s - asked.at_s) * 1e3;
    const double exposure_s = plan.frames[static_cast<std::size_t>(frame)].exposure_s;
    return {late_ms, std::max(limits.cycle_s, 0.01 * exposure_s) * 1e3, "ms", late_ms < 0};
  }
  return {0, plan.max_late_um(limits), "um", false};
}

void Controller::Impl::end_showing(double light_at_s, double at_um) {
  exposing->to_deg = at_um / plan.um_per_deg;
  exposing->exposed_s = light_at_s - exposing->shown_s;
  step.records.push_back(*std::exchange(exposing, {}));
}

void Controller::Impl::end_exposure(double light_at_s, bool is_late) {
  exposing->late = is_late;
  exposing->shown_s = shown_at_s;
  exposing->blue_share = out.blue_share;
  exposing->blue_measured = status.blue_measured;
  exposing->exposed_s = light_at_s - shown_at_s;
  lateness.add_ms((*exposing->exposed_s - *exposing->exposure_s) * 1e3);
  step.records.push_back(*std::exchange(exposing, {}));
}

void Controller::Impl::tell_late(const char* of, int number, const Punctuality& p) {
  const char* const side = p.early ? "early" : "late";
  ++late_frames;
  const int digits = plan.turns() ? 3 : 1;
  event(fmt::format("late {}", of),
        fmt::format("{}: {:.{}f} {} {}", number, p.off, digits, p.unit, side));
  if (late_frames > limits.max_late_frames || p.off > 10 * p.borne) {
    fail(Fault::late_frame, fmt::format("{} {} began {:.{}f} {} {}, {:g} {} is borne", of, number,
                                        p.off, digits, p.unit, side, p.borne, p.unit));
  }
}

void Controller::Impl::record_frame(const FrameReport& report, const Pending& asked, double at_um,
                                    bool is_late) {
  const FrameRecord record{frame,
                           asked.planned_um,
                           at_um,
                           asked.at_s,
                           shown_at_s,
                           stage.speed_um_s(now_s),
                           out.blue_share,
                           out.uv_mw_cm2,
                           status.blue_measured,
                           status.uv_measured.value_or(0),
                           is_late,
                           stage.error_um(),
                           status.temperature_c,
                           {},
                           {},
                           report.display};
  if (plan.mode == ExposureMode::layerwise) {
    exposing = record;
    exposing->exposure_s = plan.frames[static_cast<std::size_t>(frame)].exposure_s;
    complete_row();
  } else {
    lateness.add_um(at_um - asked.planned_um);
    lateness.add_ms((shown_at_s - asked.at_s) * 1e3);
    if (plan.turns()) {
      lateness.add_deg((at_um - asked.planned_um) / plan.um_per_deg);
      exposing = record;  // until the next one comes
      exposing->job_frame = plan.shown_frame(frame);
      exposing->from_deg = at_um / plan.um_per_deg;
    } else if (has_uv_display()) {
      half_shown = record;
      complete_row();
    } else {
      step.records.push_back(record);
    }
  }
}

void Controller::Impl::judge_time() {
  if (failing() || phase == Phase::done) return;
  const double silent_s = now_s - last_answer_s;
  if (!connected) {
    if (now_s - phase_since_s > kConnectS) {
      if (status_at_s && *status_at_s > now_s - 1) {
        return fail(Fault::machine_restarted,
                    fmt::format("the machine answers, but does not take set-points over: it gives "
                                "back sequence number {} since {:g} s",
                                status.sequence_echo, kConnectS));
      }
      fail(Fault::heartbeat_lost,
           fmt::format("the machine has not answered for {:g} s", kConnectS));
    }
    return;
  }
  if (silent_s > limits.heartbeat_timeout_s) {
    return fail(Fault::heartbeat_lost,
                fmt::format("no right answer for {:.0f} ms, {:.0f} ms are borne", silent_s * 1e3,
                            limits.heartbeat_timeout_s * 1e3));
  }
  const bool stands = stands_since_s && now_s - *stands_since_s > kLateArrivalS;
  if (move_limit_s > 0 && (stands || now_s > move_limit_s)) {
    move_limit_s = 0;
    return fail(Fault::stage_error,
                fmt::format("the stage is at {} and has not come to {} in time",
                            plan.place(status.stage_um), plan.place(out.target_um)));
  }
  if (pending) judge_pending(*pending, "frame");
  if (uv_pending) judge_pending(*uv_pending, "UV frame");
}

void Controller::Impl::judge_pending(const Pending& asked, const char* of) {
  if (act == Act::move && plan.mode == ExposureMode::continuous && phase == Phase::printing) {
    // The frame may have appeared up to two cycles ago and not have been reported yet.
    const double passed = stage.position_um(now_s - 2 * limits.cycle_s) - asked.planned_um;
    const double borne = plan.max_late_um(limits) * (limits.max_late_frames > 0 ? 10 : 1);
    if (passed > borne) {
      worst_late_um = std::max(worst_late_um, passed);
      const double unit_um = plan.turns() ? plan.um_per_deg : 1;
      const auto [is, may] = told_apart(passed / unit_um, borne / unit_um);
      fail(Fault::late_frame,
           fmt::format("{4} {0} has not appeared {1}{3} after its place, {2}{3} borne",
                       asked.number, is, may, plan.turns() ? "°" : " um", of));
    }
  } else if (now_s - asked.at_s > limits.heartbeat_timeout_s) {
    fail(Fault::late_frame, fmt::format("{} {} has not appeared for {:.0f} ms", of, asked.number,
                                        (now_s - asked.at_s) * 1e3));
  }
}

}  // namespace slicecorr::bridge
