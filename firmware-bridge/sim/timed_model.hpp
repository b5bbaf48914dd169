// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// The model as several wires share it: one at a time, each at its moment.
#pragma once

#include <chrono>
#include <functional>
#include <mutex>
#include <optional>

#include "slicecorr/bridge/model.hpp"

namespace slicecorr::bridge {

/// Thread-safe. In real time the model is at the present whenever it is used. In lockstep time only
/// passes by what comes over the wires: by a cycle with each exchange or, once ticks have come, by
/// them alone.
class TimedModel {
 public:
  struct Pace {
    bool lockstep = false;
    double rate = 1;  ///< of real time
    double cycle_s = 0.01;
  };
  TimedModel(PrinterModel& model, const Pace& pace);

  /// Calls `use` with the model at the present.
  void with(const std::function<void(PrinterModel&)>& use);
  /// The same for an exchange that carries set-points.
  void with_exchange(const std::function<void(PrinterModel&)>& use);
  /// The same at `at_s` in lockstep.
  void with_at(double at_s, const std::function<void(PrinterModel&)>& use);
  /// In lockstep; from now on exchanges take no time themselves.
  void tick(double at_s);
  /// The display is gone that gave them: exchanges take a cycle each again.
  void no_more_ticks();
  /// A print begins; its exchanges are counted anew from the present.
  void begin(double cycle_s);
  bool lockstep() const { return pace_.lockstep; }
  /// Real time in which `model_s` passes.
  std::chrono::duration<double> real(double model_s) const;

  /// Lets time pass until lamps are dark and the stage stands, as it would without anybody: the
  /// watchdog sees to it. At most a minute.
  void run_out();
  /// Told of events that are new, within the call that made them.
  void on_event(std::function<void(const SimEvent&)> tell);

 private:
  void count_exchanges();
  void to_present();
  void tell_new();

  PrinterModel& model_;
  Pace pace_;
  std::mutex mutex_;
  std::chrono::steady_clock::time_point began_;
  double cycles_from_s_ = 0;
  long exchanges_ = 0;
  bool ticked_ = false;
  std::size_t told_ = 0;
  std::function<void(const SimEvent&)> tell_;
};

}  // namespace slicecorr::bridge
