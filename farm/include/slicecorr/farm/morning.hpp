// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file morning.hpp
/// The page of the morning: what was done, what failed and why, which parts are worst, how busy the
/// workers were. Everything is read from the record; nothing is changed.
///
/// Plain values and thread-safe functions, but a `ReadModel` belongs to one thread. Reading throws
/// `InputError` for a time that ends before it begins, `DeviceError` as `ReadModel`. Times are ms
/// of the wall clock since 1970.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "slicecorr/farm/folder.hpp"
#include "slicecorr/farm/read_model.hpp"
#include "slicecorr/farm/scans.hpp"
#include "slicecorr/farm/status.hpp"

namespace slicecorr::farm {

struct MorningOptions {
  /// 0: a day before the end, or the farm's first event if that is later.
  std::int64_t from_ms = 0;
  std::int64_t until_ms = 0;                 ///< 0: now
  std::int64_t batch = 0;                    ///< 0: all
  int most_failures = 100, most_worst = 20;  ///< jobs to list
  int most_jobs = 2000;                      ///< in the table of all
  int log_lines = 12;                        ///< of each failure's log
};

/// A moment as people write it: "20:00" (the last one before `now_ms`), "2026-03-01 20:00" (local),
/// "90min", "36h", "2d" (before `now_ms`). Throws `InputError` naming `option`.
std::int64_t moment_of(const std::string& text, std::int64_t now_ms, const std::string& option);

struct MorningReport {
  std::string root;
  std::int64_t from_ms = 0, until_ms = 0, batch = 0;
  Overview overview;  ///< as it is now

  /// Jobs that ended in the time.
  std::int64_t done = 0, from_cache = 0, failed = 0, cancelled = 0;
  std::vector<Reasons> failed_reasons;
  struct Failure {
    Job job;
    std::vector<Attempt> attempts;
    std::vector<std::string> log_lines;  ///< the end of the last attempt's log
  };
  std::vector<Failure> failures;  ///< last ended first
  std::vector<Job> worst;         ///< done, largest height error first; without tomographic prints
  std::vector<Job> tomographic;   ///< done tomographic prints, least contrast first
  std::int64_t tomographic_done = 0;
  std::vector<Job> jobs;          ///< all that ended in the time, last ended first
  std::int64_t with_defects = 0;  ///< done, but something was wrong with their inputs

  /// Attempts that touch the time, without deliveries from the cache.
  std::int64_t attempts = 0;
  std::vector<Reasons> attempt_reasons;  ///< of those that ended without a result
  enum class BarKind { done, running, again, failed, cancelled };
  struct Bar {
    int lane = 0;  ///< index in `lanes`
    std::int64_t start_ms = 0, end_ms = 0;
    BarKind kind = BarKind::done;
    JobId job = 0;          ///< the first, where several are drawn as one
    std::int64_t jobs = 1;  ///< how many are drawn as one
    std::string words;      ///< what the bar's hint says
  };
  std::vector<std::string> lanes;  ///< names of workers: node and slot
  std::vector<Bar> bars;           ///< by lane and start; close ones drawn as one
  struct Slot {
    std::int64_t from_ms = 0;
    double done = 0;        ///< jobs that were done in it
    double cores_busy = 0;  ///< mean number of cores that work
  };
  std::vector<Slot> slots;
  std::int64_t slot_ms = 0;  ///< length of each slot
  double core_s = 0;         ///< processor time of the attempts, as far as it lies in the time
  double working_s = 0;      ///< while at least one attempt ran
  int cores = 0;             ///< of the machines whose services were there in the time

  std::int64_t delivered_bytes = 0;     ///< files of jobs that were done in the time
  std::int64_t inputs_bytes = 0;        ///< in the store now
  std::vector<PrintsOverTime> scanned;  ///< printers and resins of which a scan came in the time
};

/// With 100,000 jobs in the time this takes a second or two.
MorningReport read_morning(const FarmFolder& folder, ReadModel& model,
                           const MorningOptions& options, const FarmClock& clock = system_clock());

/// Where links to the parts' own reports lead.
struct LinkTo {
  enum class Kind { files, server } kind = Kind::files;
  std::string base;  ///< files: folder of the page, links are relative to it; empty: absolute
};
/// One file that loads nothing: no scripts, styles inline.
std::string morning_page(const MorningReport& report, const LinkTo& links);
std::string morning_json(const MorningReport& report);
/// The workers' picture alone.
std::string timeline_svg(const MorningReport& report);

}  // namespace slicecorr::farm
