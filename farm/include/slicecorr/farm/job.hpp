// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file job.hpp
/// What the farm's record holds of jobs, attempts and results: plain values, as they are read from
/// the database. Values are thread-safe as such are, functions always; nothing throws. Sizes are
/// bytes or MB (2^20 bytes), as names say; times `_ms` are of the wall clock, since 1970.
#pragma once

#include <cstdint>
#include <limits>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace slicecorr::farm {

using JobId = std::int64_t;

/// queued -> running -> done | failed | cancelled; running -> queued when an attempt is given up
/// and may be tried again; failed, cancelled -> queued by `retry` only.
enum class JobState { queued, running, done, failed, cancelled };
inline constexpr int kJobStates = 5;
/// "queued" and so on.
const char* name_of(JobState state);
std::optional<JobState> job_state_named(std::string_view name);

/// Why an attempt ended without a result, or why a queued job waits.
enum class Reason {
  none,
  bad_input,       ///< damaged, or does not fit the printer: final
  infeasible,      ///< physics forbids it: final
  input_gone,      ///< the farm's copy of an input is gone or changed: final
  too_large,       ///< needs more memory than the machine may give: final
  worker_killed,   ///< by a signal that is not ours: tried again
  worker_crashed,  ///< by a defect (exit code 1, SIGSEGV and the like): tried again
  hung,            ///< no progress for as long as settings allow: tried again
  lease_lost,      ///< the service that looked after it died or froze: tried again, not counted
  stopped,         ///< its service was stopped: tried again, not counted
  out_of_memory,   ///< tried again with more memory or fewer threads
  disk_full,       ///< tried again when there is room, not counted
  device_failed,   ///< another failure to read or write: tried again
  output_invalid,  ///< what was written could not be read back: tried again
  engine_failed,   ///< the engine could not start it, or lost it: tried again
  cancelled,       ///< on request: final
};
/// "bad_input" and so on; "" for none.
const char* name_of(Reason reason);
Reason reason_named(std::string_view name);
/// Whether a job with this reason is tried again by itself.
bool is_retried(Reason reason);
/// Whether such an attempt counts against `FarmSettings::max_attempts`.
bool is_counted(Reason reason);

inline constexpr std::int64_t kNoDeadline = std::numeric_limits<std::int64_t>::max();

/// What a tomographic print says of itself, from the contract's `tomo --json`.
struct TomoFigures {
  double contrast =
      0;  ///< void begins to gel after so many times the print's time; may be infinite
  double contrast_bound = 0;  ///< no light has more; infinite: nothing was proven
  double ver = 0;             ///< share of voxels that are void and gel with the part, 0..1
  int turns = 0;
  double print_time_s = 0;
  bool feasible = true;  ///< all of the part gels, and no void
};

/// How long a corrected stack prints (`PrintTime` in lift_times.hpp).
struct StackTime {
  double light_s = 0;               ///< in which slices are shown
  std::optional<double> print_s{};  ///< with lifts; nothing: these are not known
};

/// What a print comes to, for people (`PrintVerdict` in verdict.hpp).
struct ResultVerdict {
  std::string outcome;  ///< "as-designed", "look" or "fails"
  std::string words;    ///< a sentence or some, with a full stop
};

/// Figures of a result, from the contract's `verify --json`.
struct ResultFigures {
  int layers = 0;                                                   ///< slices of the stack
  double height_mean_um = 0, height_p95_um = 0, height_max_um = 0;  ///< height errors, >= 0
  std::int64_t lost_features = 0, merged_features = 0;
  std::int64_t cure_through_voxels = 0, undercure_voxels = 0, target_voxels = 0;
  std::optional<TomoFigures> tomo = {};  ///< of a tomographic print, which has none of the others
  std::optional<StackTime> time =
      {};  ///< of a stack; nothing of those that were made before it was told
  std::optional<ResultVerdict> verdict =
      {};  ///< of a stack; nothing of those that were made before it was told
};

/// What people ask of a result first: what the print comes to, its largest height error and lost
/// features, or the contrast of a tomographic print, its wrong voxels and its time.
std::string in_words(const ResultFigures& figures);

/// A file of a result: its name ending is "uvj" (or the format's, or "frames"), the first of a list, "html" or
/// "json"; of a stack made of meshes also "-target.uvj" and "-left-alone.uvj", as `slicecorr run` leaves them.
struct ResultFile {
  std::string ending;
  std::int64_t bytes = 0;
  std::string sha256;
};
/// The name of such a file: "NAME.uvj", "NAME-target.uvj".
std::string result_name(const std::string& name, const std::string& ending);

/// A row of the table of jobs, with what belongs to its work. Times are wall-clock ms, 0: not yet.
struct Job {
  JobId id = 0;
  std::int64_t batch = 0;  ///< number of the submission that it came with
  JobState state = JobState::queued;
  Reason reason = Reason::none;  ///< of the last attempt that failed, or why it waits
  std::string message;           ///< in words
  std::string name;              ///< stem of its output files
  std::string user;
  std::vector<std::string> labels;
  int priority = 0;                        ///< larger comes first
  std::int64_t ready_by_ms = kNoDeadline;  ///< among equal priorities the earlier comes first
  std::string key;                         ///< of its work: the same key, the same output
  JobId follows = 0;               ///< the queued or running job that does the same; 0: none
  std::vector<std::string> parts;  ///< inputs as they were submitted
  std::string kind;                ///< as `WorkSpec::kind`
  std::string printer, resin;
  std::string format;  ///< of the archive to write: its ending
  std::string output_folder;
  int layers = 0;                   ///< slices of the part
  std::int64_t voxels = 0;          ///< of the part's bounding box: the time goes with them
  double expected_s = 0;            ///< on one core, when it was submitted
  std::int64_t expected_bytes = 0;  ///< of its outputs
  int attempts = 0;                 ///< those that count (`is_counted`)
  std::int64_t not_before_ms = 0;   ///< it may start from then on
  std::string token;                ///< of the present attempt; empty: none
  bool cancel_wanted = false;
  bool from_cache = false;  ///< done without work of its own
  std::int64_t submitted_ms = 0, started_ms = 0, ended_ms = 0;
  std::optional<ResultFigures> figures;  ///< when done
  std::vector<ResultFile> files;         ///< when done

  /// Path of an output file by its ending, "html"; whether or not it is there.
  std::string output(const std::string& ending) const;
};

/// The path of the stack that a job made. Throws `InputError` where the job is not done, or the stack is
/// no longer as it was.
std::string stack_of(const Job& job);

/// One attempt to do a job. Times are wall-clock ms.
struct Attempt {
  std::string token;  ///< random, 32 hex digits; also the name of its folder
  JobId job = 0;
  int number = 0;                             ///< of this job, from 1
  std::string engine;                         ///< "local", "slurm", "cache"
  std::string engine_id;                      ///< what the engine calls it: a process, a Slurm job
  std::string service;                        ///< id of the service that looks after it
  std::string node;                           ///< where it ran
  int threads = 0;                            ///< that it was given
  std::int64_t memory_mb = 0;                 ///< the limit it was given
  std::int64_t started_ms = 0, ended_ms = 0;  ///< 0: it has not ended
  std::string phase;                          ///< "waiting", "working", "committing", "ended"
  std::string stage;                          ///< of the work, as `slicecorr` names it
  double fraction = 0;                        ///< of the whole work done, 0..1
  int layers_done = 0;                        ///< that share of all layers
  Reason reason = Reason::none;               ///< none and ended: it succeeded
  std::string message;
  int exit_code = -1;            ///< -1: not known
  double wall_s = 0, cpu_s = 0;  ///< time that passed, processor time of all threads
  std::int64_t peak_mb = 0;      ///< greatest memory
  std::string log;               ///< path of its log
};

/// One line of the append-only record.
struct FarmEvent {
  std::int64_t seq = 0;    ///< number in the record, from 1
  std::int64_t at_ms = 0;  ///< wall clock, since 1970
  JobId job = 0;           ///< 0: of the farm
  std::string attempt;     ///< token or empty
  /// submitted, started, done, failed, cancelled, retried, put_back, reprioritised,
  /// paused, resumed, draining, settings, service_started, service_stopped, service_lost,
  /// disk_low, disk_ok, night_ended, night_began, gc, cache_damaged, machine_began, machine_ended,
  /// machine_trouble, scan_kept, scan_removed, scan_beyond
  std::string kind;
  std::string text;  ///< for people
  Reason reason = Reason::none;
  std::string name{};  ///< the job's
};

/// A scan of a print, kept beside the job's results. Deviations are those from what the stack was
/// predicted to print (scan.hpp): above 0 too much was printed.
struct KeptScan {
  JobId job = 0;
  int number = 0;      ///< of the job's, from 1
  std::string folder;  ///< below scans/ of the farm, a random name
  std::string file;    ///< name of the scan as it came
  std::int64_t bytes = 0;
  std::string user;
  std::int64_t at_ms = 0;   ///< when it was kept
  std::string unit = "mm";  ///< in which its numbers were taken
  double voxel_um = 0;      ///< side of a voxel, of volumes; else 0
  std::int64_t points = 0;
  bool with_design = false;  ///< it was measured against the design, too
  double mean_um = 0, mean_abs_um = 0, p95_um = 0, worst_um = 0;  ///< the last three are >= 0
  double unseen_share = 0;                                        ///< of the surface, 0..1
  /// Of its job, where it was read from the record.
  std::string name, printer, resin;
};
/// "off by 3.1 um in the mean (too much by 1.2 um), 95 % within 8.0 um, 43 um at the worst place".
std::string in_words(const KeptScan& scan);

/// A job that was corrected with what scans of another one told.
struct NextPrint {
  JobId job = 0, of = 0;
  /// How far edges along z of that print are off, as it is understood now.
  double before_mean_um = 0, before_p95_um = 0;
  std::string words;  ///< what tuning said, lines of plain text
};

/// A service that runs, or did. Times are wall-clock ms.
struct Service {
  std::string id;
  std::string engine, host;
  long pid = 0;                                              ///< of its process
  std::int64_t started_ms = 0, seen_ms = 0, stopped_ms = 0;  ///< 0: not yet
  bool alive = false;                                        ///< its process is there
  std::string doing;  ///< "working", "paused", "draining", "outside the night window", "disk full"
  int cores = 0;      ///< that it may use
  std::int64_t memory_mb = 0;  ///< for all its workers together
};

}  // namespace slicecorr::farm
