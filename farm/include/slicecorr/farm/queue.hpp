// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file queue.hpp
/// The durable queue: every change of the record is one transaction here, and only here.
///
/// Any number of processes may use the same farm, each with its own `Queue`; an object belongs to
/// one thread at a time. A change is on the disk when its function returns. Functions wait up to a
/// minute for other writers, then throw `DeviceError` ("database is locked"), as when the disk
/// fails. A database of a newer or another program is refused with `InputError`.
///
/// The rule that keeps results single: an attempt is named by a random token, and every change that
/// an attempt makes says "where the job's token is still mine". Who lost the token changes nothing.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "slicecorr/farm/clock.hpp"
#include "slicecorr/farm/job.hpp"
#include "slicecorr/farm/settings.hpp"

namespace slicecorr::farm {

namespace detail {
class Database;
}

/// How long a lease lasts, and how often it is renewed.
inline constexpr std::int64_t kLeaseMs = 60'000;
inline constexpr std::int64_t kLeaseRenewalMs = kLeaseMs / 4;

/// Inputs stay for so long after their last submission: jobs that failed may be tried again.
inline constexpr std::int64_t kInputGraceMs = std::int64_t{24} * 3600 * 1000;

/// A file of the store.
struct InputFile {
  std::string file;        ///< its name there
  std::int64_t bytes = 0;  ///< its size
};

/// Longest delay before a job is tried again.
inline constexpr std::int64_t kLongestDelayMs = 600'000;

/// What has to be done, shared by all jobs with the same key.
struct Work {
  std::string key;         ///< SHA-256 of the canonical text of all that decides the output
  std::string spec_json;   ///< see work.hpp
  std::string setup_json;  ///< printer, resin, process, as stacks record them
  std::string setup_hash;  ///< SHA-256 of it
  std::string kind, printer, resin, format;
  std::string rate_class;                ///< work of the same class takes the same time per unit
  std::vector<std::string> input_files;  ///< names in the store
  int layers = 0;                        ///< slices of the part
  std::int64_t voxels = 0;               ///< of the bounding box
  /// Voxels times angles times steps of a tomographic print, which its time goes with; 0: with the
  /// voxels.
  std::int64_t voxel_angle_steps = 0;
  std::int64_t base_memory_mb = 0;    ///< at one thread
  std::int64_t thread_memory_mb = 0;  ///< for each further one
};

/// A job to queue.
struct NewJob {
  Work work;
  std::string name, user;
  std::string output_folder;   ///< empty: `results_folder` and the id
  std::string results_folder;  ///< "/DIR/results/"
  std::vector<std::string> parts, labels;
  int priority = 0;                        ///< larger comes first
  std::int64_t ready_by_ms = kNoDeadline;  ///< wall clock, since 1970
  double expected_s = 0;                   ///< on one core
  std::int64_t expected_bytes = 0;         ///< of its outputs
};

struct ClaimRequest {
  std::string service, engine;
  std::int64_t free_memory_mb = 0;  ///< jobs that need more at one thread are passed over
  /// What one job can ever get; 0: as much as is free. Jobs that need more are claimed as if they
  /// needed this much, so that they are tried with all of it or refused instead of waiting for
  /// ever.
  std::int64_t largest_memory_mb = 0;
  /// Only jobs with this key whose result is in the cache; empty: any.
  std::string cached_key;
  /// Whether jobs that need more memory than is free may be passed over for others (64 at most).
  bool may_overtake = true;
  /// Jobs that write into these folders are passed over: their disks are full.
  std::vector<std::string> full_folders;
};

/// A job taken by a service, under a lease.
struct Claim {
  Job job;
  std::string token;
  int number = 0;  ///< of the attempt, from 1
  std::string spec_json, setup_json;
  std::int64_t base_memory_mb = 0, thread_memory_mb = 0;  ///< as in `Work`
  bool cached = false;                                    ///< a result with this key is there
  /// How often this job ran out of memory; it gets more each time.
  int memory_failures = 0;
  std::int64_t last_memory_mb = 0;  ///< limit of the attempt before, 0: none
};

/// What is written down when an attempt ends.
struct AttemptEnd {
  Reason reason = Reason::none;  ///< none: success, by `finish` only
  std::string message, node, log;
  int exit_code = -1;            ///< -1: not known
  double wall_s = 0, cpu_s = 0;  ///< time that passed, processor time of all threads
  std::int64_t peak_mb = 0;      ///< greatest memory
};

/// What `finish` records of a result.
struct ResultRecord {
  ResultFigures figures;
  std::vector<ResultFile> files;      ///< in the cache
  std::vector<ResultFile> delivered;  ///< in the output folder; empty: the same
  std::string program;                ///< name and version that made it
  double wall_s = 0;                  ///< time that it took
};

/// A running attempt that some service is to look after.
struct OwnedAttempt {
  Attempt attempt;
  Job job;
  bool owner_alive = false;  ///< its service's process is there, or may be
  bool lease_expired = false;
};

enum class CancelOutcome { cancelled, asked, too_late, unknown };

/// Of every job besides its voxels: start of the program, reading, archive, report's frame.
inline constexpr double kFixedJobS = 0.3;

/// Measured rates, for estimates of the same class of work. Of tomographic prints the unit is a
/// voxel at an angle in a step, else a voxel.
struct Rates {
  double units_per_s = 0;     ///< on one core, `kFixedJobS` taken off; 0: never measured
  double bytes_per_unit = 0;  ///< of outputs; 0: never measured
  int samples = 0;            ///< attempts measured
};

/// Most scans of one job.
inline constexpr int kMostScansOfJob = 100;

class Queue {
 public:
  /// Opens or makes the database. `clock` must outlive this.
  explicit Queue(const std::string& database_path, const FarmClock& clock = system_clock());
  ~Queue();
  Queue(Queue&&) noexcept;

  // --- submitting -------------------------------------------------------------------------------
  /// All or nothing. Gives the ids, in order. Throws `InputError` when a user's limit is exceeded,
  /// or an output of an unfinished job would be written twice.
  /// `inputs`: those in the store that the jobs need, recorded with them.
  std::vector<JobId> submit(const std::vector<NewJob>& jobs, const std::string& user,
                            const std::string& source, const std::vector<InputFile>& inputs = {});
  Rates rates(const std::string& rate_class);
  /// The unfinished job that will write these outputs; 0: none.
  JobId unfinished_output(const std::string& output_folder, const std::string& name);

  // --- working ----------------------------------------------------------------------------------
  /// Registers a service; gives its id.
  std::string start_service(const std::string& engine, int cores, std::int64_t memory_mb);
  void stop_service(const std::string& service);
  /// The most urgent job that may run, now running under a new token; none when there is none.
  /// Looks at no settings but users' limits.
  std::optional<Claim> claim(const ClaimRequest& request);
  /// How many jobs wait, not counting those that wait for another with the same key, and those
  /// with a delay.
  std::int64_t claimable();
  /// Jobs that are queued or running, all of them.
  std::int64_t unfinished();
  /// Whether this attempt exists and has not ended.
  bool attempt_is_open(const std::string& token);
  /// What the engine calls an attempt, and what it was given.
  void record_start(const std::string& token, const std::string& engine_id, int threads,
                    std::int64_t memory_mb);
  /// Renews the leases of these attempts of the service, in one transaction; gives back the tokens
  /// that are lost. Also notes that the service is there, and what it does.
  std::vector<std::string> renew(const std::string& service, const std::vector<std::string>& tokens,
                                 const std::string& doing);
  struct Progress {
    std::string token, stage, node;
    double fraction = 0;  ///< of the whole work, 0..1
    int layers_done = 0;
  };
  void record_progress(const std::vector<Progress>& progress);
  /// From here on the attempt can't be cancelled. False: the token is no longer the job's, or a
  /// cancellation is asked for; the attempt must be given up.
  bool begin_commit(const std::string& token);
  /// Running -> done, and all that wait for the same key can be claimed. False: token lost.
  bool finish(const std::string& token, const ResultRecord& result, const AttemptEnd& end,
              bool from_cache);
  /// Ends an attempt without a result: queued again or failed, by reason and settings; cancelled
  /// when that was asked for. Followers of a job that failed for good with a reason that is theirs
  /// too (bad input, infeasible) fail with it. Gives what became of the job; nothing: token lost.
  std::optional<JobState> give_up(const std::string& token, const AttemptEnd& given);
  /// Tokens of this service whose cancellation is asked for.
  std::vector<std::string> cancellations(const std::string& service);
  /// Running attempts whose service is gone or let the lease expire.
  std::vector<OwnedAttempt> orphans();
  /// Takes over an attempt from a dead owner, compare-and-set. False: it is somebody else's.
  bool adopt(const std::string& token, const std::string& service);
  /// Running attempts of the service.
  std::vector<OwnedAttempt> owned(const std::string& service);

  // --- cache ------------------------------------------------------------------------------------
  std::optional<ResultRecord> cached(const std::string& key);
  /// Forgets a result whose files are damaged or collected.
  void forget_result(const std::string& key, const std::string& why);
  struct Collectable {
    std::string key;
    std::int64_t bytes = 0, used_ms = 0;  ///< last used: wall clock, since 1970
    bool needed = false;                  ///< a queued or running job has this key
  };
  /// Results in the cache, least recently used first.
  std::vector<Collectable> results_by_age();
  /// Files of inputs that no unfinished job needs.
  std::vector<std::string> unneeded_inputs();
  /// Whether the record has this file of the store, or an unfinished job needs it.
  bool knows_input(const std::string& file);
  void forget_input(const std::string& file);

  // --- scans ------------------------------------------------------------------------------------
  /// Records a scan whose files are in place, with an event; gives its number, from 1 in each job.
  /// Throws `InputError` where the job has as many as it may.
  int add_scan(const KeptScan& scan);
  /// False: there is none, or it was removed before.
  bool remove_scan(JobId job, int number, const std::string& by);
  void record_next(const NextPrint& next);
  /// Whether the record has a scan in this folder that was not removed.
  bool knows_scan(const std::string& folder);

  /// Number of the last event.
  std::int64_t last_event();
  /// Jobs that failed after this event, whoever did them, and were not tried again since.
  std::int64_t failed_since(std::int64_t event);

  // --- people -----------------------------------------------------------------------------------
  CancelOutcome cancel(JobId id, const std::string& by);
  /// Failed or cancelled -> queued, attempts counted anew. False: it is in another state.
  bool retry(JobId id, const std::string& by);
  bool set_priority(JobId id, int priority, const std::string& by);
  bool set_ready_by(JobId id, std::int64_t ready_by_ms, const std::string& by);
  FarmSettings settings();
  /// Changes settings by name (see settings.hpp), with an event each.
  void change_settings(const std::vector<std::pair<std::string, std::string>>& changes,
                       const std::string& by);
  void add_event(const std::string& kind, const std::string& text, JobId job = 0);

  /// A number that changes whenever another connection changed the database; cheap.
  std::int64_t data_version();

 private:
  void relead(const std::string& key);
  void end_attempt(const std::string& token, const AttemptEnd& end);
  void event(const char* kind, const std::string& text, JobId job = 0,
             const std::string& attempt = {}, Reason reason = Reason::none);
  std::vector<OwnedAttempt> open_attempts(const std::string& service);

  std::unique_ptr<detail::Database> db_;
  const FarmClock* clock_;
};

}  // namespace slicecorr::farm
