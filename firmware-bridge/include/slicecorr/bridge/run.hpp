// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file run.hpp
/// A print from beginning to end: control thread, image thread, threads that make frames, record.
/// Functions may be called from any thread, but a link, a clock and a sink belong to one call at a
/// time. What throws says so.
#pragma once

#include <atomic>
#include <functional>
#include <memory>
#include <optional>
#include <string>

#include "slicecorr/bridge/control.hpp"
#include "slicecorr/bridge/frames.hpp"
#include "slicecorr/bridge/link.hpp"
#include "slicecorr/bridge/record.hpp"

namespace slicecorr::bridge {

struct RunOptions {
  bool dry_run = false;  ///< lamps stay off
  /// Image and control in one thread, one after the other: with a step clock the print does not
  /// depend on the machine that runs it.
  bool lockstep = false;
  int threads = 2;    ///< that make frames, >= 1
  std::string stack;  ///< its path, for the record
  /// Set by signals: the print fails with `stopped_by_user`.
  const std::atomic<bool>* stop = nullptr;
};

/// How a print ended.
struct Ending {
  Phase phase = Phase::failed;
  Fault fault = Fault::none;
  std::string detail;       ///< of the fault, in words
  int frames = 0;           ///< slices in the stack
  int frames_shown = 0;     ///< slices that were shown
  int late_frames = 0;      ///< shown ones that were late
  int frame = kBlackFrame;  ///< on the display when a fault was found, else at the end
  double worst_late_um = 0, worst_stage_error_um = 0;  ///< greatest, >= 0
  double seconds = 0;                                  ///< how long it took, on the print's clock
  double stage_um = 0;    ///< measured last, or when the fault was found
  int missed_cycles = 0;  ///< cycles that began more than one cycle late
  Lateness lateness;
  LightOff light_off;
  bool latched = false;  ///< a latch was written
  Left left;             ///< after a fault: in what state lamps and stage are, as far as is known
  std::string trouble;   ///< what could not be recorded
};

/// Takes status, pause, resume and stop over the state folder's socket while it runs. Whatever
/// happens, lamps go off first, then the stage stops, then black is shown, then the fault is
/// latched; this holds for exceptions, too. The caller holds the printer's `PrintLock`. Throws only
/// for what is wrong before anything was sent: `DeviceError` where nothing can be recorded, and
/// what making the first frames throws; `InputError` where the first exchanges, which move and
/// light nothing, show that somebody else drives the machine. `uv_sink`: where the images of `Machine::uv_display` go,
/// there exactly where the machine has one.
Ending run_print(const FrameSource& frames, const PrintPlan& plan, const Machine& machine,
                 Link& link, FrameSink& sink, BridgeClock& clock, const StateFolder& folder,
                 const RunOptions& options, const ExecutionContext& context,
                 FrameSink* uv_sink = nullptr);

/// Asks the printbridge that prints now: "status", "pause", "resume" or "stop". Its answer is JSON;
/// nothing when none prints. Throws `DeviceError` when it does not answer.
std::optional<std::string> ask_running(const StateFolder& folder, const std::string& request);

/// Only reads, for some cycles: whether somebody else drives the machine. Throws `InputError` when
/// so, `DeviceError` when it does not answer. Gives what it said last.
Status check_alone(Link& link, BridgeClock& clock, const Machine& machine);

/// Begins to drive a machine that nobody else drives, with ten exchanges that move and light nothing,
/// and a look at the machine after each: a machine that takes numbers and gives status in one request
/// always gives back the own number then. The first set-points have the number `first`. A machine
/// that does not answer is left to the print's own rules. Throws as `check_alone`.
void take_over(Link& link, BridgeClock& clock, const Machine& machine, std::uint16_t first);

/// Tells the machine to reset, when its interlocks are closed and its lamps are dark, and sees that
/// they stay so. Gives its status. Throws `DeviceError` saying what is against it.
Status reset_machine(Link& link, BridgeClock& clock, const Machine& machine);

/// Something that a controller on the bench should do, and what it did.
struct MachineCheck {
  enum class Found { good, bad, not_tested };
  Found found = Found::good;
  std::string what, detail;
};
using LinkMaker = std::function<std::unique_ptr<Link>()>;
/// Drives a machine through every command and lets its watchdog trip, without light; its stage
/// moves by a millimetre at most. Each check is told as it is made. False: one of them was bad.
bool check_machine(const LinkMaker& connect, BridgeClock& clock, const Machine& machine,
                   const std::function<void(const MachineCheck&)>& tell);

}  // namespace slicecorr::bridge
