// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <fmt/format.h>

#include <algorithm>
#include <utility>

#include "control/pause.hpp"
#include "control/state.hpp"

namespace slicecorr::bridge {

namespace {
/// How many requests back it is counted how many were answered, and the share of those that were not
/// from which on it is the wire that is bad. A good wire loses one in thousands.
constexpr double kRecent = 32, kBadWire = 0.2;
}  // namespace

Controller::Impl::Impl(PrintPlan p, Machine m, bool dry)
    : plan(std::move(p)),
      machine(std::move(m)),
      limits(machine.limits),
      dry_run(dry),
      frames(static_cast<int>(plan.frames.size())),
      blue(machine.blue, machine.limits.cycle_s),
      uv(machine.uv, machine.limits.cycle_s) {
  // Forgetting must be so slow that a stage that stands still falls behind its commanded motion by
  // more than the tolerance, and is noticed.
  if (plan.speed_um_s > 0) {
    forgetting_s = std::max(2.0, 3 * machine.stage.tolerance_um / plan.slowest_um_s());
    stage.set_forgetting_s(forgetting_s);
  }
}

void Controller::Impl::event(const std::string& what, const std::string& detail) {
  step.events.push_back({now_s, what, detail, frame, stage.measured_um()});
}

void Controller::Impl::enter(Phase next, const std::string& detail) {
  phase = next;
  phase_since_s = now_s;
  turn_to(Act::begin);
  event("phase " + std::string(name_of(next)), detail);
}

void Controller::Impl::turn_to(Act next) {
  act = next;
  act_since_s = now_s;
}

void Controller::Impl::fail(Fault what, const std::string& detail) {
  if (fault != Fault::none || step.finished || phase == Phase::failed) return;
  fault = what;
  fault_detail = detail;
  // Where the stage is not heard of, images are late: the wire is to blame.
  if (what == Fault::late_frame && unanswered > kBadWire) {
    fault = Fault::heartbeat_lost;
    fault_detail +=
        fmt::format(", since {:.0f} % of requests were not answered rightly", unanswered * 100);
  }
  fault_um = stage.measured_um();
  if (phase == Phase::raising) fault_detail += " (all slices are printed)";
  event("fault " + std::string(name_of(fault)), fault_detail);
}

Controller::Controller(PrintPlan plan, Machine machine, bool dry_run, std::uint16_t first_sequence)
    : impl_(std::make_unique<Impl>(std::move(plan), std::move(machine), dry_run)) {
  impl_->next_sequence = first_sequence;
}
Controller::~Controller() = default;

ControlStep Controller::step(const std::optional<Answer>& answer, double now_s) {
  Impl& s = *impl_;
  // Keeps what was added between cycles: events of `fail`.
  ControlStep kept = std::exchange(s.step, ControlStep{});
  s.step.events = std::move(kept.events);
  const double gap_s = s.started ? now_s - s.now_s : 0;
  s.now_s = now_s;
  if (!s.started) {
    s.started = true;
    s.last_answer_s = now_s;
    s.enter(Phase::connecting);
  }
  // Noticed first, or the machine would be blamed for what it was not sent.
  if (gap_s > std::min(s.limits.heartbeat_timeout_s, s.limits.watchdog_s) && !s.failing() &&
      s.phase != Phase::done) {
    s.fail(Fault::bridge_stopped,
           fmt::format("the bridge itself did not run for {:.0f} ms: it was stopped, or the "
                       "computer slept or was too busy",
                       gap_s * 1e3));
  }
  s.answered = answer && !answer->only_read;
  if (s.connected) s.unanswered += ((s.answered ? 0.0 : 1.0) - s.unanswered) / kRecent;
  if (answer) s.take(*answer);
  s.take_reports();
  s.judge_time();
  // Two passes: a fault that go() finds still turns the lamps off in this cycle.
  for (int pass = 0; pass < 2; ++pass) {
    if (s.fault != Fault::none && !s.failing()) s.enter(Phase::lamps_off, s.fault_detail);
    s.go();
    if (s.fault == Fault::none || s.failing()) break;
  }
  if (s.failing() && s.half_shown) s.step.records.push_back(*std::exchange(s.half_shown, {}));
  // On a fault the row of a running exposure is written without its end, which nobody knows.
  if (s.failing() && s.exposing) s.step.records.push_back(*std::exchange(s.exposing, {}));
  SetPoints& out = s.out;
  if (s.dry_run || s.failing()) out.blue_share = out.uv_mw_cm2 = 0;
  out.sequence = s.next_sequence;
  s.next_sequence = next_sequence(s.next_sequence);
  // The heartbeat changes after good exchanges only. While it is not known what the machine takes
  // over, its own watchdog is to act.
  if (s.answered) ++out.heartbeat;
  out.job = s.begun && s.phase != Phase::done;
  out.watchdog_s = s.limits.watchdog_s;
  out.frame = s.plan.shown_frame(s.frame);
  ++s.sent_count;
  s.sent.push_back({out.sequence, now_s, s.phase, s.sent_count});
  if (s.sent.size() > 1024) s.sent.pop_front();
  s.blue.asked(out.blue_share, s.sent_count, now_s);
  s.uv.asked(s.uv_share(out.uv_mw_cm2), s.sent_count, now_s);
  s.step.set_points = out;
  s.step.lamps_alone = s.failing() && !s.lamps_taken;
  s.step.command_alone = s.phase >= Phase::stopping && !s.stop_taken;
  return std::exchange(s.step, ControlStep{});
}

void Controller::shown(const FrameReport& report) { impl_->reports.push_back(report); }

void Controller::written_alone(bool lamps, bool command) { impl_->written_alone(lamps, command); }

bool Controller::failing() const { return impl_->failing(); }

void Controller::fail(Fault fault, const std::string& detail) { impl_->fail(fault, detail); }

PauseAnswer Controller::pause() {
  Impl& s = *impl_;
  if (s.failing() || s.fault != Fault::none) return {false, "the print has failed"};
  if (s.phase == Phase::paused || s.phase == Phase::pausing || s.pause_wanted) {
    return {false, "the print pauses already"};
  }
  if (s.phase != Phase::printing) {
    return {false, "no slice is being printed now (" + std::string(name_of(s.phase)) + ")"};
  }
  if (s.plan.turns()) {
    return {false, "a vial that turns gets its light evenly in whole turns only"};
  }
  if (s.plan.mode == ExposureMode::layerwise) {
    if (s.next_frame + 1 >= s.frames && s.act != Act::begin) {
      return {false, "this is the last layer"};
    }
    s.pause_wanted = true;
    return {true, "pauses after layer " + std::to_string(s.next_frame)};
  }
  if (s.act != Act::move || s.move) return {false, "the stage is just starting"};
  const PausePlace place = pause_place(s.plan, s.machine, s.stage.position_um(s.now_s), s.dry_run);
  if (!place.possible) return {false, place.why};
  s.pause_wanted = true;
  s.stop_um = place.stop_um;
  return {true, fmt::format("stops at z = {:.3f} mm", (s.stop_um - s.plan.start_um) * 1e-3)};
}

PauseAnswer Controller::resume() {
  Impl& s = *impl_;
  if (s.phase == Phase::pausing) return {false, "the print is still stopping"};
  if (s.phase != Phase::paused) return {false, "the print is not paused"};
  s.resume_wanted = true;
  return {true, "goes on"};
}

Phase Controller::phase() const { return impl_->phase; }
Fault Controller::fault() const { return impl_->fault; }
const std::string& Controller::fault_detail() const { return impl_->fault_detail; }
int Controller::frame() const { return impl_->frame; }
int Controller::uv_frame() const { return impl_->uv_frame; }
double Controller::stage_um() const { return impl_->stage.measured_um(); }
double Controller::fault_stage_um() const { return impl_->fault_um; }
double Controller::speed_um_s() const { return impl_->stage.speed_um_s(impl_->now_s); }
double Controller::stage_error_um() const { return impl_->stage.error_um(); }
const Status& Controller::status() const { return impl_->status; }
const SetPoints& Controller::set_points() const { return impl_->out; }
const Lateness& Controller::lateness() const { return impl_->lateness; }
double Controller::phase_since_s() const { return impl_->phase_since_s; }
double Controller::worst_late_um() const { return impl_->worst_late_um; }
double Controller::worst_stage_error_um() const { return impl_->worst_stage_error_um; }
int Controller::frames_shown() const { return impl_->frames_shown; }
int Controller::late_frames() const { return impl_->late_frames; }
const LightOff& Controller::light_off() const { return impl_->light_off; }
bool Controller::begun() const { return impl_->begun; }

Left Controller::left() const {
  const Impl& s = *impl_;
  Left left;
  left.touched = s.begun;
  left.lamps_taken = s.failing() && s.lamps_taken;
  left.heard = s.failing() && s.heard_since();
  left.dark = s.measured_dark();
  left.stands = s.measured_still();
  left.measured = s.status_at_s.has_value();
  if (left.measured) left.measured_s_ago = std::max(0.0, s.now_s - *s.status_at_s);
  left.blue_measured = s.status.blue_measured;
  left.uv_measured = s.status.uv_measured;
  left.stage_um.reset();
  if (s.machine.has_encoder()) {
    left.stage_um = s.status.stage_um;
    if (s.machine.stage.turns()) left.stage_deg = s.status.stage_um / s.machine.stage.um_per_deg;
  }
  return left;
}

}  // namespace slicecorr::bridge
