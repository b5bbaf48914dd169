// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file clock.hpp
/// The times that the farm goes by. Wall-clock times are only recorded, shown and compared with
/// windows and deadlines; whatever must not fail when somebody sets the clock (leases, timeouts,
/// rates) goes by the steady clock. All is thread-safe, and nothing throws.
#pragma once

#include <cstdint>
#include <string>

namespace slicecorr::farm {

/// What tells the farm the time; tests have one that they set.
class FarmClock {
 public:
  virtual ~FarmClock() = default;
  /// Milliseconds since 1970, UTC; may jump either way.
  virtual std::int64_t wall_ms() const = 0;
  /// Milliseconds since the machine started, time asleep included; never falls, the same for all
  /// processes.
  virtual std::int64_t steady_ms() const = 0;
  /// Another text after each start of the machine: steady times of another start mean nothing.
  virtual std::string boot_id() const = 0;
};

/// The machine's clocks.
const FarmClock& system_clock();

/// Minutes since local midnight at a wall-clock time, 0..1439.
int local_minute(std::int64_t wall_ms);
/// The first moment after `wall_ms` at which local clocks show this minute of the day.
std::int64_t next_local_minute(std::int64_t wall_ms, int minute);
/// "HH:MM" to minutes since midnight, -1 when it is no such text.
int parse_minute(const std::string& text);
/// "HH:MM".
std::string minute_text(int minute);
/// Local time, "2026-03-01 07:00:12".
std::string local_time_text(std::int64_t wall_ms);

}  // namespace slicecorr::farm
