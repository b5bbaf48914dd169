// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file print_state.hpp
/// What is told of a print: facts that stay, and how it stands now. The control thread only copies
/// numbers; text is made of them by whoever asks. Plain values; all functions are thread-safe, but
/// `state_of`, which belongs to the controller's thread. Nothing here throws.
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "slicecorr/bridge/control.hpp"
#include "slicecorr/bridge/machine.hpp"
#include "slicecorr/bridge/plan.hpp"

namespace slicecorr::bridge {

/// Settled before anything moves.
struct PrintFacts {
  std::string stack, printer, display;
  std::string uv_display;  ///< empty: UV images have no display of their own
  bool dry_run = false, layerwise = false, uv = false;
  int frames = 0;                                   ///< slices in the stack
  double layer_um = 0;                              ///< slice height
  double speed_um_s = 0;                            ///< planned; 0 layer by layer
  double slowest_um_s = 0;                          ///< where slices go at speeds of their own
  double start_um = 0, end_um = 0, expected_s = 0;  ///< as in `PrintPlan`
  double max_late_um = 0;                           ///< as in `Limits`
  double tolerance_um = 0;                          ///< as in `Stage`
  double cycle_s = 0;                               ///< as in `Limits`
  int max_late_frames = 0, ring_frames = 0;         ///< as in `Limits`
  int angles = 0;                                   ///< of a job: frames of a turn; else 0
  double um_per_deg = 0;                            ///< of a job: as in `Stage`
  /// Whether the stage turns: then um are those of the arc at the vial's inner wall.
  bool turns() const { return angles > 0 && um_per_deg > 0; }
  struct Begin {
    double slice = 0, at_s = 0;
  };
  /// When slices begin, in seconds from the first one's begin, where not all take the same time: on
  /// straight lines between these, to a 200th of the print. The last is the end. Empty: all take the
  /// same time.
  std::vector<Begin> begins;
  /// When slice `slice` begins, 0..frames; between two of them for broken numbers.
  double begin_s(double slice) const;
};
PrintFacts facts_of(const PrintPlan& plan, const Machine& machine);

/// How a print stands at `at_s` of its clock.
struct PrintState {
  Phase phase = Phase::connecting;
  Fault fault = Fault::none;
  std::string detail;                     ///< of the fault
  int frame = kBlackFrame;                ///< on the display
  int uv_frame = kBlackFrame;             ///< on the UV display
  int frames_shown = 0, late_frames = 0;  ///< so far
  double newest_at_s = 0;  ///< when the last of `frames_shown` came, on the print's clock
  int missed_cycles = 0;   ///< that began more than one cycle late, so far
  double at_s = 0, phase_since_s = 0;   ///< on the print's clock
  double stage_um = 0, speed_um_s = 0;  ///< position above the window, measured
  double stage_error_um = 0;            ///< measured less commanded
  double worst_late_um = 0;             ///< so far, along the stage's way
  double worst_stage_error_um = 0;      ///< so far
  double blue_share = 0;                ///< asked of the blue lamp, 1: as calibrated
  double blue_measured = 0;             ///< share, as `blue_share`
  double uv_mw_cm2 = 0;                 ///< asked of the UV lamp
  std::optional<double> uv_measured;    ///< mW/cm²; nothing: the machine does not tell
  std::optional<double> temperature_c;  ///< nothing: the machine does not tell
  std::optional<Left> left;             ///< once a fault's order is given
  Lateness lateness;
  std::uint64_t told = 0;  ///< how often the control thread has handed this over
};
PrintState state_of(const Controller& controller, double at_s, int missed_cycles);

/// What is not known of the state by the control thread, or costs something to know.
struct PrintAround {
  std::optional<int> ready_frames;     ///< frames decoded ahead
  std::optional<std::uint64_t> asked;  ///< questions that were answered so far
  std::optional<double> seconds;       ///< how long the print took; nothing: it goes on
  std::string threads;                 ///< real-time priority and memory locking, as it was got
};

/// Seconds until the end of the last slice, as planned from where the print is; nothing after it and
/// on a fault.
std::optional<double> left_s(const PrintFacts& facts, const PrintState& state);

/// How late the latest frame was, um of the stage's way, one that has not appeared included; >= 0.
double latest_um(const PrintState& state);

/// "341 of 412 frames", with thousands apart: how all views count. Frames have numbers from 0 on, as
/// slices have, so that the last of them is frame 340.
std::string shown_in_words(const PrintFacts& facts, const PrintState& state);

/// One JSON object (docs/bridge-watching.md). The same text in `status`, in status.json and, the facts
/// alone, in the journal's first line.
std::string state_json(const PrintFacts& facts, const PrintState& state, const PrintAround& around);
std::string facts_json(const PrintFacts& facts);

/// A place counted from the first slice's begin: "z = 1.234 mm", or of a stage that turns (`Stage`)
/// "123.4° on from the first"; `um_per_deg` 0: it moves along a line.
std::string place_in_words(double z_um, double um_per_deg);

/// A length of the stage's way: "1.23 um", or of a stage that turns (`um_per_deg` > 0) "0.006°
/// (1.23 um at the wall)".
std::string way_in_words(double um, double um_per_deg);

/// The angle of a stage that turns within its turn, from the index on, 0 up to 360, to hundredths.
double angle_in_turn_deg(const PrintFacts& facts, const PrintState& state);
/// The turn of a job that is shown, or was shown last, from 1; 0 before the first frame.
int turn_of(const PrintFacts& facts, const PrintState& state);
/// "turn 3 of 10", "before the first of 10 turns".
std::string turn_in_words(const PrintFacts& facts, const PrintState& state);

/// What somebody should do about a fault.
std::string_view what_to_do(Fault fault);

}  // namespace slicecorr::bridge
