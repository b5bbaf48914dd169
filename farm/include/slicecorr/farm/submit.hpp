// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file submit.hpp
/// From what people write to jobs in the queue: jobs files, command lines, REST bodies. Everything
/// is checked before anything is queued, and every error is told, with file and line.
///
/// Functions are thread-safe, but a `Queue` belongs to one thread. Wrong requests throw
/// `SubmitErrors`, failing disks and databases `DeviceError`.
#pragma once

#include <map>
#include <memory>
#include <string>
#include <vector>

#include "slicecorr/error.hpp"
#include "slicecorr/farm/folder.hpp"
#include "slicecorr/farm/queue.hpp"
#include "slicecorr/farm/store.hpp"
#include "slicecorr/parallel.hpp"
#include "slicecorr/plate.hpp"
#include "slicecorr/setup.hpp"
#include "slicecorr/stack.hpp"

namespace slicecorr::cli {
struct MeshOptions;
}

namespace slicecorr::farm {

/// Where a field of a request was said.
struct SaidField {
  std::string where;      ///< "jobs.toml: line 12"
  bool default_ = false;  ///< for all jobs of a file that do not say it themselves
};

struct SubmitError {
  std::string where;
  std::string message;
  /// What its job would have failed with: `infeasible`, or `bad_input` for all else.
  Reason reason = Reason::bad_input;
  /// Of the requests that `prepare` was given, the one that can't be done; below 0 where the error
  /// is of none in particular.
  std::ptrdiff_t request = -1;
};

/// A job as somebody asks for it.
struct JobRequest {
  bool as_options = false;  ///< messages name options of the command line, not keys
  std::string where;        ///< "jobs.toml:12", "jobs.csv:3", "command line", for messages
  /// Meshes that share a plate or vial, one archive of slices, or one volume (.npy) to be printed
  /// tomographically.
  std::vector<std::string> parts;
  double layer_um = 0;  ///< 0: the archive says it
  /// Least and greatest height of layers that follow slopes; empty: all are alike, or said by
  /// `setup.layer_heights_um`.
  std::vector<double> adaptive_um;
  std::string antialias = "on", units = "auto";
  double scale = 1;   ///< of the mesh, a factor > 0
  double fit_mm = 0;  ///< longest side of all parts together, in place of `scale`; 0: not given
  /// x and y on the plate; about x, y and z; empty: not given.
  std::vector<double> center_mm, rotate_deg;
  PlateChoices plate;
  /// Meshes and stacks of what is shown as it is sliced beside the part (left_alone.hpp).
  std::vector<std::string> leave_alone;
  /// Of an archive: meshes that it holds beside supports, which are left alone (find_part.hpp).
  std::vector<std::string> part_inside;
  SetupChoices setup;  ///< mode also "tomography"
  /// The speed, or layer by layer the exposure, is found for each part (plan.hpp): `prepare` does so.
  bool plan = false;
  double tolerance_um = 0, gap_contrast = 0;  ///< as `PlanAsk`; 0: its defaults
  /// By how much inputs may be off, as `slicecorr --uncertain` takes it, and whether corrections allow
  /// for it; empty: not said.
  std::string uncertain;
  bool robust = false;
  std::string planned;  ///< what was found, in words; empty before and without `plan`
  /// Of tomographic prints; 0 and empty: not given.
  std::vector<std::string> inserts;  ///< what turns with the part: meshes, or volumes
  double voxel_mm = 0;
  std::string method, window;  ///< as the options of `slicecorr tomo solve`
  int angles = 0, iterations = 0;
  double clip_sigma = 0, stop_error = 0, max_time_s = 0;
  bool beyond_reach = false;
  /// Fields that were said, by their key, so that those of another mode are refused where they stand.
  /// A default that does not fit a job is passed over; one that fits none is refused.
  std::map<std::string, SaidField> said;
  std::string name;      ///< of the outputs; empty: the first part's
  std::string format;    ///< of the archive: a name or ending; empty: uvj
  std::string out;       ///< output folder; empty: results/ID of the farm
  int copies = 1;        ///< >= 1: name, name-2, name-3 ...
  int priority = 0;      ///< larger comes first
  std::string ready_by;  ///< "07:00", the next time clocks show it; or "2026-03-01 07:00"
  std::vector<std::string> labels;
  std::string user;     ///< empty: who submits
  std::string machine;  ///< of machines.toml, which is to print it; empty: none
  /// A stack that is printed again: its process holds where `setup` says nothing. Null: none.
  std::shared_ptr<const StackInfo> like;
  /// Defaults that were left out, by key: where each was said, and why it has no place in this job.
  std::map<std::string, SubmitError> passed_over;
  /// What is wrong with how it was written, of `read_jobs_to_check`.
  std::vector<SubmitError> wrong;
};

/// How the parts of a request lie and are drawn, from the options of meshes.
void place_as(JobRequest& r, const cli::MeshOptions& mesh);
/// Makes the paths of a request absolute, from the present folder.
void absolute_paths(JobRequest& request);

/// All errors found, as one exception: `what` has one line for each.
class SubmitErrors : public InputError {
 public:
  explicit SubmitErrors(std::vector<SubmitError> errors);
  const std::vector<SubmitError>& errors() const { return errors_; }
  /// Whether nothing but physics is in the way.
  bool all_infeasible() const;

 private:
  std::vector<SubmitError> errors_;
};

/// Reads a jobs file, TOML or CSV by its ending; paths in it are relative to its folder, those of
/// `defaults` to the present one. Throws `SubmitErrors` with all that is wrong.
std::vector<JobRequest> read_jobs_file(const std::string& path, const JobRequest& defaults = {});
/// The same, but what is wrong with single jobs stays with them (`JobRequest::wrong`), so that `prepare`
/// tells it with all else; what is wrong with the file or its defaults is thrown.
std::vector<JobRequest> read_jobs_to_check(const std::string& path,
                                           const JobRequest& defaults = {});
/// Texts of such files; paths stay as they are. `source` names them in messages.
std::vector<JobRequest> parse_jobs_toml(const std::string& text, const std::string& source,
                                        const JobRequest& defaults = {});
std::vector<JobRequest> parse_jobs_csv(const std::string& text, const std::string& source,
                                       const JobRequest& defaults = {});
/// Most jobs of one request over HTTP, copies counted; and most errors that one is told.
inline constexpr int kMostJobsOfRequest = 2000, kMostErrorsTold = 100;
/// Most numbers in lists of such a request, copies counted.
inline constexpr std::size_t kMostNumbersOfRequest = 1000000;
/// {"defaults": {...}, "jobs": [{...}]} with the keys of jobs files; for the REST API. More than
/// `kMostJobsOfRequest` jobs are refused before anything is made of them.
std::vector<JobRequest> parse_jobs_json(const std::string& text, const std::string& source,
                                        const JobRequest& defaults = {});

/// What a job will be and cost.
struct Estimate {
  std::string name, where;
  int layers = 0;               ///< slices of the part
  std::int64_t voxels = 0;      ///< of its bounding box
  double seconds = 0;           ///< on one core
  std::int64_t disk_bytes = 0;  ///< of its outputs
  std::int64_t memory_mb = 0;   ///< at one thread
  bool cached = false;          ///< the result is there already
  bool duplicate = false;       ///< the same work as an earlier job of this submission
  std::string planned;          ///< `JobRequest::planned`
  bool measured = false;        ///< by rates that this farm measured, else by a guess
};

struct Submission {
  std::vector<NewJob> jobs;
  std::vector<Estimate> estimates;  ///< one for each job
  std::vector<InputFile> inputs;    ///< in the store
  /// Keeps the inputs until the jobs are queued; null in a dry run.
  std::shared_ptr<InputLock> lock;
};

/// Checks and resolves all requests: reads meshes and archives, resolves printers, resins and
/// processes, asks the physics, looks for names that are written twice. `store`: inputs are copied
/// into the farm; else nothing is written (a dry run). Defaults that a job has no place for are passed over,
/// which is told once for each. Throws `SubmitErrors` with all that is wrong with any of them; what was copied
/// until then goes again.
Submission prepare(const std::vector<JobRequest>& requests, const FarmFolder& folder, Queue& queue,
                   const std::string& user, bool store, const ExecutionContext& context);

struct Submitted {
  std::vector<JobId> ids;
  std::int64_t done_from_cache = 0;
};
/// Queues what `prepare` made, and finishes at once what the cache has. When nothing can be queued
/// the inputs go again.
Submitted submit(const Submission& submission, const FarmFolder& folder, Queue& queue,
                 const std::string& user, const std::string& source);

}  // namespace slicecorr::farm
