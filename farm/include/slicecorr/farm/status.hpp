// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file status.hpp
/// The farm at a moment: as text, as JSON, and as a frame of the live view. Plain values and
/// thread-safe functions, but a `ReadModel` belongs to one thread. What reads the record throws
/// `DeviceError` as `ReadModel`; nothing else throws.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "slicecorr/farm/folder.hpp"
#include "slicecorr/farm/read_model.hpp"

namespace slicecorr::farm {

/// Free room where the farm and its store are.
struct DiskState {
  std::string what;  ///< "farm", "store"
  std::string path;
  std::int64_t free_bytes = -1, total_bytes = -1;  ///< -1: can't be found out
};
/// One entry where both are on the same disk.
std::vector<DiskState> disk_states(const FarmFolder& folder);

/// All of the farm but its lists of jobs.
struct Overview {
  std::int64_t now_ms = 0;  ///< wall clock, since 1970
  Summary summary;
  FarmSettings settings;
  std::vector<Service> services;  ///< those that are alive
  std::vector<RunningJob> running;
  std::vector<DiskState> disks;
};
/// From one consistent state of the record.
Overview read_overview(ReadModel& model, const FarmFolder& folder,
                       const FarmClock& clock = system_clock());

/// What `status` shows.
struct StatusPage {
  Overview overview;
  std::vector<Job> jobs;
  std::int64_t total = 0;              ///< jobs that the filter lets through
  std::int64_t limit = 0, offset = 0;  ///< the filter's
};
/// Without states in the filter: what runs, then what waits in the order in which it will start,
/// what failed, what was cancelled and what was done last, together `filter.limit` jobs.
StatusPage read_status(ReadModel& model, const FarmFolder& folder, const JobFilter& filter,
                       const FarmClock& clock = system_clock());

/// For people; lines are cut at `columns` where that is above 0.
std::string status_text(const StatusPage& page, const FarmFolder& folder, int columns);
std::string status_json(const StatusPage& page, const FarmFolder& folder);
std::string overview_json(const Overview& overview);

/// "2 running, 98 queued, 100 done, 0 failed; 3 h 10 min left".
std::string overview_line(const Overview& overview);

/// A frame of the live view.
struct LiveState {
  Overview overview;
  std::vector<Job> next;          ///< in the order in which they will start
  std::vector<FarmEvent> latest;  ///< oldest first
};
LiveState read_live(ReadModel& model, const FarmFolder& folder, int rows,
                    const FarmClock& clock = system_clock());
/// At most `rows` lines of at most `columns` characters. `colour`: with SGR sequences, which take
/// no columns.
std::vector<std::string> live_frame(const LiveState& state, const FarmFolder& folder, int columns,
                                    int rows, bool colour);
/// An event as one line, without its time.
std::string event_text(const FarmEvent& event);

/// Why nothing starts: "outside the night window", "paused", "draining", "no service is running" or
/// "disk full"; empty: nothing is in the way.
std::string what_holds(const Overview& overview);

/// The end of an attempt's log, whole lines of at most `most_bytes`; empty when there is none.
/// Reads only files in the farm's own folders, whatever the record says.
std::string log_tail(const FarmFolder& folder, const Attempt& attempt, std::int64_t most_bytes);

}  // namespace slicecorr::farm
