// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file settings.hpp
/// What a shop sets for its farm: kept in the database, so that it holds for every service and
/// outlives them. Services take up a change within a second. Plain values; functions are
/// thread-safe. Only `set_setting` throws.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>

namespace slicecorr::farm {

struct FarmSettings {
  bool paused = false;    ///< start nothing; what runs goes on
  bool draining = false;  ///< start nothing, and services end when nothing runs
  /// Jobs start only from `night_from` to `night_until`, minutes since local midnight; both -1: at
  /// any time. May go over midnight. What runs at the end goes on.
  int night_from = -1, night_until = -1;
  int user_running = 0;  ///< jobs of one user that run at a time; 0: any number
  int user_queued = 0;   ///< unfinished jobs one user may have; more are refused; 0: any number
  /// For these users instead of the two numbers above: running, queued; -1: not said.
  std::map<std::string, std::pair<int, int>> users;
  std::int64_t min_free_mb = 1024;  ///< nothing starts when a disk it writes to has less
  int max_attempts = 3;             ///< of a job; those that count, see `is_counted`
  double hang_s = 1800;             ///< a worker without progress for so long is ended
  double retry_delay_s = 5;         ///< doubles with each attempt, up to 10 minutes
  std::int64_t cache_max_mb = 0;    ///< `gc` and services keep the cache below; 0: no limit
  /// What a job's label asks of Slurm: "constraint:X", "partition:X" or "gres:X". Taken up when a
  /// service starts.
  std::map<std::string, std::string> slurm_labels;
  bool operator==(const FarmSettings&) const = default;
};

/// Sets one by its name and text ("night", "20:00-07:00"); throws `InputError` naming what was
/// expected. Names: paused, draining, night (HH:MM-HH:MM or off), user-running, user-queued,
/// user-running.NAME, user-queued.NAME, min-free-mb, max-attempts, hang-s, retry-delay-s,
/// cache-max-mb, slurm-label.LABEL (constraint:X, partition:X, gres:X or none).
void set_setting(FarmSettings& settings, const std::string& name, const std::string& text);
/// All that can be set, with their texts.
std::map<std::string, std::string> setting_texts(const FarmSettings& settings);

/// The limits that hold for a user; 0: none.
int running_limit(const FarmSettings& settings, const std::string& user);
int queued_limit(const FarmSettings& settings, const std::string& user);

/// Whether jobs may start at this minute of the local day.
bool in_night_window(const FarmSettings& settings, int local_minute);

}  // namespace slicecorr::farm
