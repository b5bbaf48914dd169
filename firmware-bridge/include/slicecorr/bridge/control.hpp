// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file control.hpp
/// The print as a state machine. It knows no thread, no wire and no clock: each cycle it is told
/// the status and the time and says what goes out. All of the policy is here (docs/safety.md).
///
/// Values and functions without an object are thread-safe. A `Controller` belongs to one thread.
/// Nothing here throws: what is wrong becomes a fault. Times are s of the print's clock (0 at its
/// start), positions um of the stage above the window where nothing else is said; light is a share
/// of what the calibration stands for (1: all of it) for blue, and mW/cm² for UV.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "slicecorr/bridge/frames.hpp"
#include "slicecorr/bridge/plan.hpp"

namespace slicecorr::bridge {

enum class Phase {
  connecting,  ///< waits for the first answer
  warming,     ///< lamps warm up behind black
  homing,      ///< to where the print begins
  uv_on,       ///< UV before blue
  printing,
  pausing,
  paused,
  resuming,
  blue_off,  ///< blue off before UV
  uv_off,
  raising,  ///< part out of the resin; a vial comes to rest
  done,
  // a fault, in this order
  lamps_off,
  stopping,
  blacking,
  failed,
};
std::string_view name_of(Phase phase);

enum class Fault {
  none,
  underrun,  ///< a frame was not decoded in time
  late_frame,
  wrong_frame,        ///< the display showed another one, or none
  heartbeat_lost,     ///< no answer from the machine
  machine_restarted,  ///< its sequence numbers or state are not ours
  stage_error,        ///< not where it should be
  lamp_mismatch,      ///< not as bright as asked
  uv_ratio,           ///< too little UV for the frame's blue light
  door_open,
  stop_pressed,
  over_temperature,
  lamp_failed,
  stage_failed,
  watchdog_tripped,
  display_gone,
  stopped_by_user,
  impossible_measurement,  ///< it says what can't be
  bridge_stopped,          ///< the bridge itself did not run for a while
  defect,
};
/// "stage_error" and so on.
std::string_view name_of(Fault fault);
/// Nothing when no fault has this name.
std::optional<Fault> fault_of(std::string_view name);

/// Something for the journal.
struct PrintEvent {
  double at_s = 0;   ///< on the print's clock
  std::string what;  ///< "phase printing", "fault stage_error", "lamps off" ...
  std::string detail;
  int frame = kBlackFrame;  ///< on the display
  double stage_um = 0;      ///< measured, above the window
  std::string facts = {};   ///< a JSON object with more of it; empty: none
};

/// How a frame was printed: a row of the frame log. What is asked and measured is as it was when
/// the frame was shown; of blue light layer by layer, when its exposure ended.
struct FrameRecord {
  int frame = 0;                        ///< number of the slice, from 0
  double planned_um = 0;                ///< stage position at which its light was to begin
  double stage_um = 0;                  ///< stage position at which its light began
  double planned_s = 0;                 ///< when its light was to begin, on the print's clock
  double shown_s = 0;                   ///< when its light began, on the print's clock
  double speed_um_s = 0;                ///< of the stage; above 0: away from the window
  double blue_share = 0;                ///< asked of the blue lamp, >= 0; 1: as calibrated
  double uv_mw_cm2 = 0;                 ///< asked of the UV lamp, >= 0
  double blue_measured = 0;             ///< share, as `blue_share`
  double uv_measured = 0;               ///< mW/cm²; 0 where the machine does not tell
  bool late = false;                    ///< further off its place (or exposed longer) than borne
  double stage_error_um = 0;            ///< measured less commanded
  std::optional<double> temperature_c;  ///< nothing where the machine does not tell
  /// Layer by layer: the exposure asked for and the one that was given, s, > 0; nothing in
  /// continuous prints, and for `exposed_s` where the exposure did not end.
  std::optional<double> exposure_s, exposed_s;
  DisplayTimes display = {};
  /// Where UV images have a display of their own: when the light of this frame's began there, and
  /// where the stage was then; nothing where it did not come.
  std::optional<double> uv_shown_s = {}, uv_stage_um = {};
  /// Of a job: its frame, and the angles of the stage between which it was shown, from the index on;
  /// `to_deg` and `exposed_s` not where the print failed meanwhile.
  int job_frame = kBlackFrame;
  std::optional<double> from_deg = {}, to_deg = {};
};

/// How late frames were, counted while they are printed. Continuous: when a frame's light began,
/// along the stage's way (of a stage that turns also in degrees) and in time. Layer by layer: how
/// much longer than asked an exposure was, in time alone. What is early counts as in time.
struct Lateness {
  static constexpr std::array<double, 12> kBoundsUm{0.05, 0.1, 0.2, 0.5, 1,   2,
                                                    5,    10,  20,  50,  100, 200};
  static constexpr std::array<double, 12> kBoundsDeg{0.005, 0.01, 0.02, 0.05, 0.1, 0.2,
                                                     0.5,   1,    2,    5,    10,  20};
  static constexpr std::array<double, 13> kBoundsMs{0.1, 0.2, 0.5, 1,   2,   5,   10,
                                                    20,  50,  100, 200, 500, 1000};
  /// Number of frames with values up to each bound and above the one before; the last: above all.
  std::array<std::uint64_t, kBoundsUm.size() + 1> um{};
  std::array<std::uint64_t, kBoundsDeg.size() + 1> deg{};
  std::array<std::uint64_t, kBoundsMs.size() + 1> ms{};
  double sum_um = 0, sum_deg = 0, sum_ms = 0;        ///< of all values
  double worst_um = 0, worst_deg = 0, worst_ms = 0;  ///< the greatest
  void add_um(double late_um);
  void add_deg(double late_deg);
  void add_ms(double late_ms);
};

/// Continuous prints: slices whose light was off by more than a tenth of it, as far as it is measured.
/// That is so where the machine does not answer while the speed changes: lamps can't follow then.
struct LightOff {
  int slices = 0;    ///< how many so far
  int slice = -1;    ///< that which is off most; -1: none
  double light = 1;  ///< what it got, 1: as planned
};

/// A status, and when it was true on the print's clock.
struct Answer {
  Status status;
  double at_s = 0;  ///< on the print's clock
  /// Half the time from question to answer, >= 0: the status was true some time within so much of
  /// `at_s`.
  double within_s = 0;
  /// The exchange failed, and the status was read by itself after it: what it measures counts, but
  /// it confirms no set-points.
  bool only_read = false;
};

/// What a cycle asks for.
struct ControlStep {
  SetPoints set_points;
  /// Lamps off, or the command to stop, are to be written by themselves before the rest goes out: a
  /// fault asks for it until the machine has answered that it took them (`written_alone`).
  bool lamps_alone = false, command_alone = false;
  /// Frame to show next, from 0, or `kBlackFrame`; nothing: what is on the display stays. There is
  /// no next one until `Controller::shown` has been told of it, except black on a fault.
  std::optional<int> show;
  double show_at_s = 0;  ///< when to show it, on the print's clock: its light then begins in time
  /// The same of the UV display, where there is one.
  std::optional<int> show_uv;
  double show_uv_at_s = 0;
  bool finished = false;  ///< the print has ended, well or not: there is no further step
  std::vector<PrintEvent> events;
  std::vector<FrameRecord> records;
};

/// What the controller is told after a frame was shown, and when one was not ready.
struct FrameReport {
  int number = kBlackFrame;  ///< of the slice, from 0, or black
  double shown_at_s = 0;     ///< when its light began, on the print's clock
  bool missing = false;      ///< underrun
  DisplayTimes display = {};
  bool on_uv_display = false;  ///< else on that of blue images
};

struct PauseAnswer {
  bool accepted = false;
  std::string why;  ///< what physics says against it, or where it will pause
};

/// What a fault left of lamps and stage, as far as the machine has said so: numbers only.
struct Left {
  bool touched = false;      ///< something was moved or lit
  bool lamps_taken = false;  ///< the machine has answered that it put lamps off
  bool heard = false;        ///< it has told what it measures since the fault; then hold:
  bool dark = false;         ///< lamps are measured dark
  bool stands = false;       ///< the stage stands still, as far as its speed is measured
  bool bridge_gone = false;  ///< the program that printed was killed, or the power failed
  /// Whether anything was ever measured, and how long before `time`, s, where that is known; the
  /// fields below are of that measurement.
  bool measured = false;
  std::optional<double> measured_s_ago;
  double blue_measured = 0;  ///< share, 1: as calibrated
  /// Above the window; nothing of a stage whose machine has no encoder.
  std::optional<double> stage_um = 0;
  std::optional<double> stage_deg;    ///< the same of a stage that turns
  std::optional<double> uv_measured;  ///< mW/cm²; nothing where the machine does not tell
  std::string time = {};              ///< UTC, of the end of the print; empty: now
  /// Nothing was touched, or lamps and stage are known to be off and still.
  bool confirmed() const { return !touched || (heard && dark && stands); }
};
/// "NOT CONFIRMED that lamps are off ...": what somebody must be told first.
std::string in_words(const Left& left);

/// What can't be in a status, in words; empty: nothing.
std::string impossible(const Machine& machine, const Status& status);
/// Lamps that are measured lit, in words; empty: dark.
std::string lit(const Machine& machine, const Status& status);
/// Interlocks that are open, in words; empty: none.
std::string interlocks(const Machine& machine, const Status& status);
/// What a machine that was not told anything yet says against a print on it, and what to do;
/// empty: nothing. `machine_is_clear`: somebody has seen that there is no part on it.
std::string against_start(const Machine& machine, const Status& status, bool machine_is_clear);

class Controller {
 public:
  /// `dry_run`: lamps stay off. `first_sequence`: number of the first set-points, not 0: one by
  /// chance, so that an answer to somebody else's is not taken for one to ours.
  Controller(PrintPlan plan, Machine machine, bool dry_run, std::uint16_t first_sequence = 1);
  ~Controller();
  /// One cycle: the last exchange (nothing: no answer) and the time now. The set-points go out at
  /// once; the next call is a cycle later.
  ControlStep step(const std::optional<Answer>& answer, double now_s);
  void shown(const FrameReport& report);
  /// The machine has answered that it took what the last step wanted written by itself.
  void written_alone(bool lamps, bool command);
  /// Whether the order of a fault is being given.
  bool failing() const;
  /// A fault from outside: display gone or wrong, defect, stop by the user. The first fault counts.
  void fail(Fault fault, const std::string& detail);
  PauseAnswer pause();
  PauseAnswer resume();

  Phase phase() const;
  Fault fault() const;
  const std::string& fault_detail() const;
  int frame() const;     ///< shown last, or `kBlackFrame`
  int uv_frame() const;  ///< the same on the UV display
  double stage_um() const;
  double fault_stage_um() const;  ///< where the stage was when the fault was found
  double speed_um_s() const;
  double stage_error_um() const;  ///< measured less commanded
  /// The machine's last status, and the set-points that went out last.
  const Status& status() const;
  const SetPoints& set_points() const;
  const Lateness& lateness() const;
  double phase_since_s() const;  ///< when the phase began, on the print's clock
  /// Largest lateness and position error so far.
  double worst_late_um() const;
  double worst_stage_error_um() const;
  int frames_shown() const;
  int late_frames() const;
  const LightOff& light_off() const;
  /// What a fault left of lamps and stage.
  Left left() const;
  /// Whether anything was moved or lit: a fault before that needs no latch.
  bool begun() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace slicecorr::bridge
