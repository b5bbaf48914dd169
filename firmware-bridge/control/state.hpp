// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Inside of the controller. Its parts: `judge.cpp` judges what the machine says, `light.cpp`
/// the light of slices, `act.cpp`, `act_layerwise.cpp` and `act_fault.cpp` say what comes next, `controller.cpp` holds them together.
#pragma once

#include <algorithm>
#include <cmath>
#include <deque>
#include <optional>
#include <string>
#include <utility>

#include "control/lamps.hpp"
#include "control/motion.hpp"
#include "slicecorr/bridge/control.hpp"

namespace slicecorr::bridge {

/// Steps within a phase.
enum class Act {
  begin,
  uv_warm,
  uv_settle,
  blue_warm,
  blue_settle,
  blue_dark,
  uv_dark,
  show_first,
  spin,      ///< a vial comes to its speed, dark
  spin_lit,  ///< the lamp comes on, behind black
  move,
  arrive,
  settle,
  show,
  light,
  expose,
  finish,
};

struct Controller::Impl {
  Impl(PrintPlan p, Machine m, bool dry);

  const PrintPlan plan;
  const Machine machine;
  const MachineLimits& limits;
  const bool dry_run;
  const int frames;

  Phase phase = Phase::connecting;
  Act act = Act::begin;
  double now_s = 0, phase_since_s = 0, act_since_s = 0;
  bool started = false;
  Fault fault = Fault::none;
  std::string fault_detail;
  double fault_um = 0;  ///< where the stage was when it was found
  bool pause_wanted = false, resume_wanted = false;
  bool begun = false;  ///< something was moved or lit

  // The wire.
  SetPoints out;
  std::uint16_t next_sequence = 1;
  std::uint64_t sent_count = 0;
  struct Sent {
    std::uint16_t sequence;
    double at_s;
    Phase phase;
    std::uint64_t count;
  };
  std::deque<Sent> sent;
  double last_answer_s = 0;
  bool answered = false, connected = false, seen_running = false;
  double unanswered = 0;  ///< share of the last requests
  Status status;
  std::optional<double> status_at_s;  ///< nothing: the machine was never heard
  std::optional<double> not_running_since_s, uv_short_since_s;

  // The stage.
  StageEstimate stage;
  double forgetting_s = 2;
  struct Move {
    std::uint16_t sequence;  ///< of the set-points with which it goes out first
    double target_um, speed_um_s, acceleration_um_s2;
    bool new_speed = false;  ///< the motion goes on, at another speed
    double at_s = 0;         ///< when it was told first
  };
  std::optional<Move> move;  ///< commanded, but not known to be taken over yet
  double move_limit_s = 0;   ///< when it must have arrived
  double move_within_s = 0;  ///< how far off the time may be at which the last one was taken over
  /// Since when the commanded motion is at its end.
  std::optional<double> stands_since_s;
  double highest_um = 0;  ///< stage position reached so far while printing
  /// A slower slice comes: up to where it begins the stage is told no more than its speed.
  double slow_until_um = 0, slow_um_s = 0;
  double put_off_um = 0;  ///< of a job: whole turns by which it begins later than planned
  /// Without an encoder: by how much what the stage's own speed adds up to differs from the
  /// commanded motion, forgotten as fast as a difference of measured positions is.
  double slipped_um = 0;
  double slipped_at_s = 0;
  double slip_speed_um_s = 0;           ///< greatest speed commanded lately, forgotten as slips are
  std::optional<double> unsteady_at_s;  ///< when the speed was last not what it should be
  double worst_stage_error_um = 0;

  // The lamps.
  LampJudge blue, uv;
  bool lamps_judged = false;
  bool rising = false;  ///< waits for a lamp: too little light is no fault yet
  struct AskedLight {
    double at_s, share;
  };
  std::deque<AskedLight> shares;  ///< asked of the blue lamp within its settling time
  struct Passing {
    double slices, at_s;
    double light;  ///< of the lamp, 1: as calibrated
  };
  std::optional<Passing> passing;  ///< where the stage was measured last, in slices, and when
  bool slice_is_whole = false;     ///< the slice there was entered on this way
  double slice_light = 0;          ///< that it got so far, s/um
  LightOff light_off;

  // The display.
  int frame = kBlackFrame;  ///< on the display
  int next_frame = 0;       ///< to be shown next
  struct Pending {
    int number;
    double planned_um, at_s;  ///< where and when its light is to begin
  };
  std::optional<Pending> pending;
  // The UV display, where there is one.
  int uv_frame = kBlackFrame;
  std::optional<Pending> uv_pending;
  /// Its frame's row waits until both displays have told of it.
  std::optional<FrameRecord> half_shown;
  struct UvShown {
    int number;
    double at_s, at_um;
  };
  std::optional<UvShown> uv_shown;  ///< told last
  std::vector<FrameReport> reports;
  double shown_at_s = 0;  ///< when the light of the frame on the display began
  int frames_shown = 0, late_frames = 0;
  double worst_late_um = 0;
  Lateness lateness;
  std::optional<FrameRecord> exposing;  ///< layer by layer: its row waits for the exposure's end
  double stop_um = 0;                   ///< where the stage stops for a pause
  int paused_frame = kBlackFrame;       ///< to be shown again after the pause

  // A fault's order.
  int tries = 0;
  double fault_at_s = 0;
  bool lamps_taken = false, stop_taken = false;  ///< the machine has answered that it took them
  bool black_shown = false, uv_black_shown = false;

  ControlStep step;

  void event(const std::string& what, const std::string& detail = {});
  void enter(Phase next, const std::string& detail = {});
  void turn_to(Act next);
  double in_act_s() const { return now_s - act_since_s; }
  void fail(Fault what, const std::string& detail);
  bool failing() const { return phase >= Phase::lamps_off; }
  /// The machine has said something since the fault.
  bool heard_since() const { return status_at_s && *status_at_s >= fault_at_s; }
  /// Whether the lamps are measured dark, whatever was asked for.
  bool measured_dark() const {
    return status.blue_measured <= machine.blue.tolerance &&
           uv_share(status.uv_measured.value_or(0)) <= machine.uv.tolerance;
  }
  /// Whether the stage is not driven any more, and where its speed is measured has come to rest: it
  /// does not go by its tolerance in a second.
  bool measured_still() const {
    return status.state != MachineState::running &&
           std::abs(status.stage_speed_um_s.value_or(0)) <= machine.stage.tolerance_um;
  }

  // judge.cpp
  void take(const Answer& answer);
  void take_reports();
  // light.cpp
  /// Adds up the light of the slices that the stage passes.
  void judge_light();
  /// `light_s_um`: integral of (share of light)^m over the time in the slice, over its height.
  void tell_light(int slice, double light_s_um);
  void judge_time();
  void check_sequence(const Answer& answer);
  /// The machine has taken what was written by itself.
  void written_alone(bool lamps, bool command);
  void check_measured();
  void check_interlocks();
  void check_state();
  void check_stage();
  void check_lamps();
  void judge_frame(const FrameReport& report);
  void judge_uv_frame(const FrameReport& report);
  /// Adds what the UV display told to the row of its frame.
  void complete_row();
  /// A frame that has been asked for and does not come.
  void judge_pending(const Pending& asked, const char* of);
  /// How far off a frame came: where the stage moves in um, at the end of an exposure in ms, else
  /// 0.
  struct Punctuality {
    double off, borne;
    const char* unit;
    bool early;
    bool late() const { return off > borne; }
  };
  /// Notes the worst of frames that come while the stage moves.
  Punctuality punctuality(const FrameReport& report, const Pending& asked, double light_at_s,
                          double at_um);
  /// Of a layer whose black has come.
  void end_exposure(double light_at_s, bool is_late);
  /// `of`: "frame", "UV frame".
  void tell_late(const char* of, int number, const Punctuality& p);
  void record_frame(const FrameReport& report, const Pending& asked, double at_um, bool is_late);

  // act.cpp
  void go();
  void go_connecting();
  void go_warming();
  void go_homing();
  void go_uv_on();
  void go_printing();
  void go_pausing();
  void go_paused();
  void go_resuming();
  void go_blue_off();
  void go_uv_off();
  void go_raising();
  void go_fault();
  void go_done();
  void go_layers();
  /// Moves to the place of layer `n`, or on to what comes after the last one.
  void begin_layer(int n);
  /// Shows black when the exposure of layer `n` is over, then puts the lamp out.
  void expose_layer(int n);
  double print_target_um() const;
  /// Place of a frame, and of the last one's end.
  double frame_um(int n) const { return plan.frame_um(n) + put_off_um; }
  double end_um() const { return plan.end_um + put_off_um; }
  /// A vial: waits until it goes steadily, then for the lamp.
  void go_spinning();
  /// Of a job: the row of the frame that ends.
  void end_showing(double light_at_s, double at_um);
  void check_slip();

  void command_move(double target_um, double speed_um_s, double acceleration_um_s2);
  void hold();
  /// Speed that the stage is to be told now: that of its slice, or of a slower one that it must
  /// brake for.
  double speed_to_tell();
  /// Tells the stage the speed of its slice.
  void follow_speeds();
  /// At the target, within the stage's tolerance.
  bool arrived() const;
  bool has_uv_display() const { return machine.uv_display.has_value(); }
  /// On both displays at once.
  void show(int number, double planned_um, double light_at_s);
  void show_blue(int number, double planned_um, double light_at_s);
  void show_uv(int number, double planned_um, double light_at_s);
  /// From asking for a frame to its light on both displays, at least.
  double latency_s() const {
    return has_uv_display() ? std::max(limits.display_latency_s, machine.uv_display->latency_s)
                            : limits.display_latency_s;
  }
  bool any_pending() const { return pending || uv_pending; }
  bool blue_displayed(int number) const { return !pending && frame == number; }
  bool uv_displayed(int number) const {
    return !has_uv_display() || (!uv_pending && uv_frame == number);
  }
  bool displayed(int number) const { return blue_displayed(number) && uv_displayed(number); }
  void plan_next_frame();
  void follow();
  /// UV intensity that the plan asks for with a frame, mW/cm².
  double uv_of(int number) const;
  bool uv_settled() const;
  bool blue_settled() const;
  bool blue_dark() const;
  bool uv_dark() const;
  void lamp_limit(double limit_s, const char* what);
  /// Whether the lamp gives what was asked for; it is a fault when that takes too long in this act.
  bool uv_came();
  bool blue_came();
  bool uv_went();
  bool blue_went();
  double uv_share(double mw_cm2) const {
    return plan.uv_max_mw_cm2 > 0 ? mw_cm2 / plan.uv_max_mw_cm2 : 0;
  }
};

}  // namespace slicecorr::bridge
