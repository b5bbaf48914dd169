// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file engine.hpp
/// Where work runs: processes of this machine, or a cluster. An engine only executes; queue, retry,
/// cache and record are the service's, whatever the engine.
///
/// A task is one attempt. Its folder holds all it needs (work.hpp), so a node needs to see the
/// farm's store and the program, but never the database. What a worker produced counts only when it
/// stands in the folder's result.json and the token is still the job's.
///
/// An engine belongs to one thread, the service's main one; making one is thread-safe. Functions
/// must not block for long: a cancellation has to reach a worker within two seconds. Making one
/// throws `InputError` or `DeviceError` where it can't work; after that what fails is a report or
/// `trouble`, and only a failing disk throws `DeviceError`.
#pragma once

#include <chrono>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "slicecorr/farm/job.hpp"

namespace slicecorr::farm {

struct Task {
  std::string token;  ///< of the attempt
  JobId job = 0;
  std::string name;            ///< of the job, for people
  std::string folder;          ///< attempts/TOKEN, with order.json in it
  int threads = 1;             ///< >= 1
  std::int64_t memory_mb = 0;  ///< the worker limits itself to this; the engine may, too
  int priority = 0;            ///< larger comes first
  std::int64_t ready_by_ms = kNoDeadline;  ///< wall clock, since 1970
  double expected_s = 0;                   ///< on one core; 0: not known
  std::vector<std::string> labels;
};

enum class TaskState { waiting, running, ended };

/// What the engine knows of a task.
struct TaskReport {
  std::string token;  ///< of the attempt
  TaskState state = TaskState::waiting;
  std::string node;    ///< where it runs; empty: not known
  int exit_code = -1;  ///< ended: as the worker gave it; -1: not known
  int signal = 0;      ///< ended by this signal; 0: not by one
  /// What the engine itself says of the end, where it knows better than the exit code: out of
  /// memory by its limit, node lost (`worker_killed`), never started (`engine_failed`).
  Reason reason = Reason::none;
  std::string message;
  double cpu_s = 0;          ///< processor time of all threads; 0: not known
  std::int64_t peak_mb = 0;  ///< greatest memory; 0: not known
};

struct FarmNode {
  std::string name;
  std::string state;  ///< "idle", "busy", "down" or what the engine says
  bool usable = true;
  int cores = 0, cores_used = 0;
  std::int64_t memory_mb = 0, memory_used_mb = 0;
  std::vector<std::string> labels;
};

/// How much more an engine takes at present.
struct EngineCapacity {
  int tasks = 0;                       ///< that may be submitted now, at most
  std::int64_t memory_mb = 0;          ///< for the next task, at most
  std::int64_t largest_memory_mb = 0;  ///< that a task could ever get: more is `too_large`
  int cores = 0;                       ///< free, for the choice of threads
};

class Engine {
 public:
  virtual ~Engine() = default;
  virtual std::string name() const = 0;  ///< "local", "slurm"
  /// What it takes now; asked before each claim.
  virtual EngineCapacity capacity() = 0;
  /// How many threads and how much memory the next task gets. `waiting`: jobs that could start,
  /// this one included. The default shares the free cores among them.
  struct TaskSize {
    int threads = 1;
    std::int64_t memory_mb = 0;
  };
  virtual TaskSize share(const EngineCapacity& capacity, std::int64_t waiting,
                         std::int64_t base_memory_mb, std::int64_t thread_memory_mb) const;
  /// Starts tasks; gives for each what the engine calls it, "" where it could not be started (a
  /// report with `ended` and `engine_failed` follows from `poll`).
  virtual std::vector<std::string> submit(const std::vector<Task>& tasks) = 0;
  /// What changed since the last call; `ended` comes exactly once for each task.
  virtual std::vector<TaskReport> poll() = 0;
  /// Waits until something may have changed, `wake_fd` is readable (-1: none) or time is up.
  virtual void wait(std::chrono::milliseconds most, int wake_fd) = 0;
  /// Ends these tasks: asks first, forces after a second. Their `ended` follows.
  virtual void cancel(const std::vector<std::string>& tokens) = 0;
  /// Nothing may start now (pause, drain, the night's end): tasks that wait are taken back. They
  /// end with `stopped`. Called again and again while it is so.
  virtual void withdraw() {}
  /// Another service looks after these tasks now: what is remembered of them is forgotten, and no
  /// `ended` follows. Only where work outlives its service.
  virtual void forget(const std::vector<std::string>& tokens) { cancel(tokens); }
  /// The ends that were reported are recorded, and their attempts' folders gone: what the engine
  /// keeps of them on the disk goes, too. `last`: the service ends.
  virtual void tidy(bool /*last*/) {}
  /// After a restart: which of these attempts of this engine still wait or run. They are reported
  /// by `poll` from now on; the others are gone.
  virtual std::vector<std::string> adopt(const std::vector<Attempt>& attempts) = 0;
  /// The machines on which tasks run.
  virtual std::vector<FarmNode> nodes() = 0;
  /// Why nothing can run now, in words for people: nobody answers, no node takes work. Empty: it
  /// can.
  virtual std::string trouble() const { return {}; }
  /// Whether tasks survive the end of this process (then a service may stop without ending them).
  virtual bool outlives_service() const = 0;
};

struct LocalEngineOptions {
  std::string program;         ///< path of slicefarm
  int jobs = 0;                ///< at a time; 0: as many as cores
  int cores = 0;               ///< 0: all that this process may use
  std::int64_t memory_mb = 0;  ///< for all workers together; 0: most of what is free
};
/// Workers as processes of this machine.
std::unique_ptr<Engine> make_local_engine(const LocalEngineOptions& options);

struct SlurmEngineOptions {
  std::string program;  ///< path of slicefarm on the nodes
  std::string store;    ///< the farm's, as this machine and all nodes see it
  std::string partition, account, qos;
  int queue_ahead = 0;  ///< tasks in Slurm at a time; 0: twice the cores of the partition
  int throttle = 0;     ///< tasks of one array that run at a time at most; 0: any number
  /// "LABEL=constraint:X", "LABEL=partition:X" or "LABEL=gres:X": what is asked of Slurm for jobs
  /// with this label. Other labels mean nothing to it.
  std::vector<std::string> label_map;
  /// Slurm's time limit is this many times the estimate, at least half an hour; 0: no limit.
  double time_factor = 10;
  double poll_s = 2;  ///< between two listings; more when Slurm takes long to answer
  std::vector<std::string> sbatch_arguments;  ///< added as they are
};
/// Workers as tasks of a Slurm cluster. Throws `InputError` for options that can't be,
/// `DeviceError` when the cluster does not answer.
std::unique_ptr<Engine> make_slurm_engine(const SlurmEngineOptions& options);

}  // namespace slicecorr::farm
