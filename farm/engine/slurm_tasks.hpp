// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file slurm_tasks.hpp
/// How tasks of the farm stand for tasks of Slurm's arrays, and what follows from what Slurm says
/// of them. Pure functions and files of the store; no command is run here.
///
/// Tasks of equal needs go to Slurm as one array, a batch. A batch is known by a random token: the
/// job's comment is "slicefarm:FARM:BATCH", and task N of the array is the Nth token of
/// store/slurm/BATCH/batch.json, which is written before the job is submitted. So a service that
/// was killed at any moment finds its work again, whatever job numbers it had written down: after a
/// crash of its controller Slurm may give the same numbers to other jobs.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "engine/slurm_text.hpp"
#include "slicecorr/farm/engine.hpp"

namespace slicecorr::farm::detail {

/// Exit codes of the job's script, besides those of the worker (contract) and of the shell.
enum ScriptCode {
  script_no_write = 74,  ///< the attempt's folder can't be written
  script_started = 75,   ///< this attempt was started before
  script_no_folder = 78  ///< the node does not see the attempt's folder
};

/// Where a task is in Slurm: batch and number in the array.
using TaskPlace = std::pair<std::string, int>;

struct Batch {
  std::string token;
  std::vector<std::string> tasks;  ///< tokens of the attempts
};

/// The folder store/slurm.
class BatchFolder {
 public:
  explicit BatchFolder(std::string store);
  /// Random, made once for a store: tells our jobs from those of another farm of the same user.
  const std::string& farm() const { return farm_; }
  /// Writes a batch's file, synced, and a link to each task's log. Throws `DeviceError`.
  void write(const Batch& batch) const;
  /// Those that are there; what is unreadable is left out.
  std::vector<Batch> read_all() const;
  std::optional<Batch> read(const std::string& token) const;
  void remove(const std::string& token) const;
  std::string path(const std::string& token) const { return folder_ + "/" + token; }
  bool has_attempt(const std::string& token) const;
  /// Whether none of its attempts has a folder any more.
  bool has_ended(const std::string& token) const;

 private:
  std::string store_, folder_, farm_;
};

/// Folders of batches in a store that no attempt needs any more, those that were not written to
/// their end included. `is_open`: whether the attempt of a token has not ended.
std::vector<std::string> ended_batch_folders(
    const std::string& store, const std::function<bool(const std::string& token)>& is_open);

/// What tasks must have in common to go into one array.
struct Needs {
  int threads = 1;
  std::int64_t memory_mb = 0;  ///< of Slurm's limit
  int time_min = 0;            ///< 0: the partition's
  int nice = 0;
  std::string partition, constraint, gres;
  auto operator<=>(const Needs&) const = default;
};
/// Throws `InputError` when a label is mapped to two partitions.
Needs needs_of(const Task& task, const SlurmEngineOptions& options);

/// The nodes of a partition, and what they sum up to.
struct Cluster {
  std::vector<SlurmNode> nodes;
  int cores = 0, idle_cores = 0, largest_cores = 0;  ///< of usable nodes
  /// What a worker can get at most, on any node: one that is down now may be back in time.
  std::int64_t largest_memory_mb = 0;
};
/// `partition` empty: all. Throws `InputError` when there are none.
Cluster cluster_of(const std::vector<SlurmNode>& nodes, const std::string& partition);

/// Why no node takes work, with the state of some of them; empty: one does.
std::string no_node_works(const Cluster& cluster);

/// Checks "label=constraint:X", "label=partition:X", "label=gres:X"; "label=X" is a constraint.
/// Throws `InputError`.
void check_label(const std::string& mapping);

/// Arguments of sbatch; the script goes to its stdin.
std::vector<std::string> sbatch_arguments(const Needs& needs, const Batch& batch,
                                          const BatchFolder& folder, const std::string& store,
                                          const std::string& name,
                                          const SlurmEngineOptions& options);
std::string job_script(const Batch& batch, const std::string& store, const std::string& program);
/// Names of at most 40 letters, digits, "._-".
std::string job_name(const std::vector<std::string>& names);
/// The word in single quotes, for sh.
std::string quoted(const std::string& text);

std::string comment_of(const std::string& farm, const std::string& batch);
/// The batch of a job of this farm; empty: it is none.
std::string batch_of(const std::string& comment, const std::string& farm);

/// What a listing of Slurm says of one task.
struct Sight {
  SlurmJob job;
  std::string id;  ///< for scancel: "57_3"
};
/// All tasks of our batches that a listing has. Where a task is there twice (sbatch may submit
/// twice when the controller is slow), what runs goes before what waits, and that before what has
/// ended; the others are `doubles`.
struct Sightings {
  std::map<TaskPlace, Sight> tasks;
  std::vector<std::string> doubles;  ///< ids of those that wait
};
Sightings sightings(const std::vector<SlurmJob>& jobs, const std::string& farm,
                    const std::map<std::string, int>& sizes);

/// What an engine remembers of a task that it looks after. Times are steady ms.
struct HeldTask {
  std::string token, folder;
  TaskPlace place;
  std::string id;             ///< of the last sight; empty: never seen
  std::int64_t since_ms = 0;  ///< listings begun before say nothing of it
  bool told = false;
  TaskState state = TaskState::waiting;
  std::string node, message;
  int absences = 0;  ///< listings in a row that did not have it
  std::int64_t absent_since_ms = 0, ended_since_ms = 0, refused_since_ms = 0;
  std::int64_t cancelled_ms = 0;  ///< a cancellation was asked for; 0: none
  bool withdrawn = false;         ///< ... because nothing may start now
  bool signalled = false;         ///< its worker was asked to end, the job was not cancelled
  bool forced = false;            ///< ... and killed
};

struct Patience {
  /// What Slurm does not list any more is given up after so many listings and so long.
  int absences = 3;
  std::int64_t absent_ms = 5000;
  /// A result may become visible this long after Slurm says that the job has ended: file systems of
  /// several machines keep old listings for a while.
  std::int64_t result_ms = 30'000;
  /// ... and when the worker failed, so that there may be none.
  std::int64_t failure_ms = 5000;
  /// A job that Slurm says it can never start is given up after this.
  std::int64_t refused_ms = 60'000;
  /// A cancelled task that Slurm does not confirm counts as ended: its token is worth nothing.
  std::int64_t cancel_ms = 10'000;
};

/// Whether Slurm has written into a job's log that it was killed for its memory: not all kinds of
/// limits show in the job's state.
bool says_over_memory(const std::string& log_path);

/// What a worker has left in its folder: nothing yet, its result, or that it was asked to stop.
enum class WorkerTrace { nothing, result, stopped };

/// What a listing (begun at `begun_ms`, judged at `now_ms`) means for a task: a report when there
/// is news. `sight`: null when it was not listed. Changes `held`.
std::optional<TaskReport> judge(HeldTask& held, const Sight* sight, WorkerTrace left,
                                std::int64_t begun_ms, std::int64_t now_ms,
                                const Patience& patience);

}  // namespace slicecorr::farm::detail
