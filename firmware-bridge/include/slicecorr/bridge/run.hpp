/// @file run.hpp
/// A print from beginning to end: control thread, image thread, decoding threads, record.
#pragma once

#include <atomic>
#include <functional>
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
  int threads = 2;  ///< that decode
  /// Set by signals: the print fails with `stopped_by_user`.
  const std::atomic<bool>* stop = nullptr;
};

struct Ending {
  Phase phase = Phase::failed;
  Fault fault = Fault::none;
  std::string detail;
  int frames_shown = 0, late_frames = 0;
  double worst_late_um = 0, worst_stage_error_um = 0, seconds = 0;
};

/// Takes pause, resume, stop and status over the state folder's socket while it runs. Whatever
/// happens, lamps go off first, then the stage stops, then black is shown, then the fault is
/// latched; this holds for exceptions, too.
Ending run_print(const StackReader& stack, const PrintPlan& plan, const Machine& machine,
                 Link& link, FrameSink& sink, Clock& clock, const StateFolder& folder,
                 const RunOptions& options, const Job& job);

}  // namespace slicecorr::bridge
