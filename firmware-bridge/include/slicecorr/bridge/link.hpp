/// @file link.hpp
/// The wire to the machine. One thread owns it.
#pragma once

#include <memory>
#include <optional>
#include <string>

#include "slicecorr/bridge/machine.hpp"

namespace slicecorr::bridge {

/// One exchange after another with a machine: over Modbus, or with a model in the same process.
class Link {
 public:
  virtual ~Link() = default;
  /// Sends the set-points and gives the status, or nothing when there was no (right) answer in
  /// time. A set-point that was not answered may have been taken over all the same. Never blocks
  /// longer than two response timeouts, never throws for what happens on the wire.
  virtual std::optional<Status> exchange(const SetPoints& set_points) = 0;
  /// Only reads the status, as `exchange` does.
  virtual std::optional<Status> look() = 0;
  /// Why there was no answer, for the journal.
  virtual std::string last_error() const = 0;
};

/// libmodbus with RECOVERY_NONE: input is flushed before each request, every error closes the
/// connection, which is made anew at the next exchange, without blocking. Throws `InputError` when
/// the map can't be used.
std::unique_ptr<Link> make_modbus_link(const RegisterMap& map, const Limits& limits);

/// Time of a print. In tests and `--lockstep` it only moves when somebody sleeps.
class Clock {
 public:
  virtual ~Clock() = default;
  virtual double now_s() const = 0;
  virtual void sleep_until(double time_s) = 0;
};
/// CLOCK_MONOTONIC, from 0 at the start; `rate` times as fast.
std::unique_ptr<Clock> make_real_clock(double rate = 1.0);
/// Moves only by sleeping.
std::unique_ptr<Clock> make_step_clock();

}  // namespace slicecorr::bridge
