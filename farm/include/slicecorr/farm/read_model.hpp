// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file read_model.hpp
/// All that status, live view, pages, metrics and notifications read, and nothing that changes
/// anything. Opens the database read-only; never blocks a writer. Each function sees one consistent
/// state; a `Snapshot` keeps the same state for several calls.
///
/// A `ReadModel` is for one thread; functions that only take values are thread-safe. A database
/// that can't be read throws `DeviceError`.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "slicecorr/farm/clock.hpp"
#include "slicecorr/farm/job.hpp"
#include "slicecorr/farm/settings.hpp"

namespace slicecorr::farm {

namespace detail {
class Database;
}

/// Which jobs, and in which order.
struct JobFilter {
  std::vector<JobState> states;     ///< empty: all
  std::string user, label, text;    ///< empty: any; `text` occurs in the name or an input
  std::int64_t batch = 0;           ///< 0: any
  std::int64_t ended_since_ms = 0;  ///< wall clock, since 1970; 0: at any time
  enum class Order {
    id,           ///< oldest first
    newest,       ///< last submitted first
    urgency,      ///< in which they will start (queued)
    ended,        ///< last ended first
    worst_height  ///< largest height error first (done)
  } order = Order::id;
  std::int64_t limit = 100, offset = 0;  ///< jobs to give, and to pass over first
  bool with_message = false;             ///< only those that end with one: done, that is a warning
};

/// Counts and sums of the whole farm.
struct Summary {
  std::array<std::int64_t, kJobStates> jobs{};  ///< by JobState
  std::int64_t followers = 0;   ///< queued, waiting for another job with the same key
  std::int64_t from_cache = 0;  ///< done without work of their own
  std::int64_t attempts = 0, attempts_failed = 0;
  double queued_s = 0;                 ///< work left on one core, running jobs' rest included
  int running_threads = 0;             ///< of all running jobs
  std::int64_t running_memory_mb = 0;  ///< limits of all running jobs
  double voxels_done = 0, busy_s = 0;  ///< of all attempts that succeeded; wall clock
  double eta_s = 0;       ///< until the queue is empty at the present pace; < 0: not known
  std::int64_t late = 0;  ///< unfinished jobs that will miss their "ready by"
  std::int64_t cache_bytes = 0, cache_entries = 0;
  std::int64_t first_submitted_ms = 0, last_ended_ms = 0;  ///< wall clock, since 1970
  std::int64_t last_event = 0;                             ///< seq
};

/// A running job with what its worker says.
struct RunningJob {
  Job job;
  Attempt attempt;
  double seconds = 0;       ///< since its start
  double layers_per_s = 0;  ///< mean since its start; 0: not known yet
  double eta_s = -1;        ///< until its end; < 0: not known yet
};

struct Reasons {
  Reason reason = Reason::none;
  std::int64_t jobs = 0;
};

/// Sums of attempts, for metrics.
struct AttemptTotals {
  Reason reason = Reason::none;  ///< none: succeeded
  std::string engine;
  std::int64_t attempts = 0;
  double wall_s = 0, cpu_s = 0;  ///< sums of all their times
};

class ReadModel {
 public:
  /// Throws `InputError` when there is no farm, or one of a newer program.
  explicit ReadModel(const std::string& database_path, const FarmClock& clock = system_clock());
  ~ReadModel();
  ReadModel(ReadModel&&) noexcept;

  /// All calls until the object goes out of scope see the same state.
  class Snapshot {
   public:
    explicit Snapshot(ReadModel& model);
    ~Snapshot();

   private:
    ReadModel& model_;
  };

  Summary summary();
  std::vector<Job> jobs(const JobFilter& filter);
  std::int64_t count(const JobFilter& filter);
  std::optional<Job> job(JobId id);
  std::vector<RunningJob> running();
  std::vector<Attempt> attempts(JobId id);
  /// Events with a seq above `after`, oldest first; `job` 0: of all.
  std::vector<FarmEvent> events(std::int64_t after, std::int64_t limit, JobId job = 0);
  /// The last ones, oldest first.
  std::vector<FarmEvent> last_events(std::int64_t limit);
  std::vector<Reasons> failures();
  std::vector<AttemptTotals> attempt_totals();
  /// Scans that were not removed, oldest first; `job` 0: of all.
  std::vector<KeptScan> scans(JobId job = 0);
  /// What a job was corrected with, where scans told it.
  std::optional<NextPrint> next_of(JobId job);
  /// What a job does, as JSON: its `WorkSpec` and its setup. Empty texts where there is no such job.
  std::pair<std::string, std::string> work_of(JobId job);
  std::vector<Service> services();
  FarmSettings settings();
  std::vector<std::string> users();
  /// A number that changes whenever the database was changed; cheap: ask it before reading again.
  std::int64_t data_version();

 private:
  std::unique_ptr<detail::Database> db_;
  const FarmClock* clock_;
};

/// What `status --json` and the REST API give.
std::string job_json(const Job& job);
std::string attempt_json(const Attempt& attempt);
/// Without `folder` and `file`'s place: those who ask know names.
std::string scan_json(const KeptScan& scan);
std::string event_json(const FarmEvent& event);
std::string summary_json(const Summary& summary, const FarmSettings& settings,
                         const std::vector<Service>& services);

}  // namespace slicecorr::farm
