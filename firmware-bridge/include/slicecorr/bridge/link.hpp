// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file link.hpp
/// The wire to the machine, and the time of a print. A `Link` belongs to one thread. The real clock
/// is thread-safe, the step clock belongs to one thread. Nothing throws but where it says so.
#pragma once

#include <memory>
#include <optional>
#include <string>

#include "slicecorr/bridge/machine.hpp"

namespace slicecorr::bridge {

/// What can be written by itself, so that it gets through where a machine refuses other registers.
enum class Alone { lamps, command };

/// One exchange after another with a machine: over Modbus, or with a model in the same process.
class Link {
 public:
  virtual ~Link() = default;
  /// Sends the set-points and gives the status, or nothing when not all of it was answered
  /// (rightly) in time. Every request is sent, whatever became of those before it. A set-point that
  /// was not answered may have been taken over all the same. Blocks for the response timeout of
  /// each request (`requests_of`) at most, never throws for what happens on the wire.
  virtual std::optional<Status> exchange(const SetPoints& set_points) = 0;
  /// Writes only the registers of the lamps, or of the command, as these set-points have them,
  /// before the exchange of the same cycle. True: the machine has answered that they are written.
  /// The first after a good exchange does not wait for the next attempt to connect.
  virtual bool write_alone(const SetPoints& set_points, Alone what) = 0;
  /// Only reads the status, as `exchange` does.
  virtual std::optional<Status> look() = 0;
  /// What the machine did instead of answering as it should, after "it ": "does not answer: ...",
  /// "answers with exception 4 ...".
  virtual std::string last_error() const = 0;
};

/// Modbus: input is flushed before each request; an answer that does not come or can't be trusted
/// closes a TCP connection, which is made anew without blocking, at growing intervals. Throws
/// `InputError` when the map can't be used.
/// `lockstep`: time passes by exchanges, so how long a busy computer takes for one must not count. A
/// machine that answered the request before in time is waited for 1 s, others as in real time.
std::unique_ptr<Link> make_modbus_link(const RegisterMap& map, const MachineLimits& limits,
                                       bool lockstep = false);

/// One bridge per machine on this computer, whatever names and state folders printers have: held as
/// long as it lives, and gone with the process.
class MachineLock {
 public:
  /// Of the machine's address: host (looked up), port and unit, or the serial line. Throws
  /// `InputError` when another process holds it, or the host is not found; `DeviceError` when the
  /// system has no room for it.
  explicit MachineLock(const RegisterMap& map);
  ~MachineLock();
  MachineLock(const MachineLock&) = delete;
  MachineLock& operator=(const MachineLock&) = delete;

 private:
  int socket_ = -1;
};

/// The clock that the bridge goes by. In tests and `--lockstep` it only moves when somebody sleeps.
class BridgeClock {
 public:
  virtual ~BridgeClock() = default;
  virtual double now_s() const = 0;  ///< since the clock was made
  /// Returns at once when `time_s` of this clock is over.
  virtual void sleep_until(double time_s) = 0;
};
/// CLOCK_MONOTONIC, from 0 at the start; `rate` (> 0) times as fast.
std::unique_ptr<BridgeClock> make_real_clock(double rate = 1.0);
/// Moves only by sleeping.
std::unique_ptr<BridgeClock> make_step_clock();

}  // namespace slicecorr::bridge
