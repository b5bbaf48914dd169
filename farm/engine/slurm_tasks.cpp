// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "engine/slurm_tasks.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <fstream>
#include <string_view>

#include "slicecorr/error.hpp"

namespace slicecorr::farm::detail {

namespace {

constexpr const char* kMark = "slicefarm:";

struct Mapping {
  std::string label, kind, value;
};

Mapping parse_label(const std::string& text) {
  const std::size_t equals = text.find('=');
  Mapping m;
  if (equals != text.npos) {
    m.label = text.substr(0, equals);
    m.value = text.substr(equals + 1);
  }
  m.kind = "constraint";
  for (const char* kind : {"constraint", "partition", "gres"}) {
    if (m.value.starts_with(std::string(kind) + ":")) {
      m.kind = kind;
      m.value = m.value.substr(m.kind.size() + 1);
      break;
    }
  }
  const bool clean = std::none_of(m.value.begin(), m.value.end(), [](char c) {
    return static_cast<unsigned char>(c) <= ' ' || c == '\'' || c == '"';
  });
  if (m.label.empty() || m.value.empty() || !clean) {
    throw InputError(fmt::format(
        "'{}' maps no label; expected LABEL=constraint:X, LABEL=partition:X or LABEL=gres:X",
        text));
  }
  return m;
}

/// Slurm's time limit, min: estimate times `factor`, rounded up to steps so that jobs of like
/// length share an array; 0: none.
int time_limit_min(double expected_s, double factor) {
  if (factor <= 0 || expected_s <= 0) return 0;
  const double minutes = expected_s * factor / 60;
  int limit = 30;
  while (limit < minutes && limit < 30 << 14) limit *= 2;
  return limit;
}

/// The worker's own limit is on its data; Slurm's counts stacks, libraries and cached files, too.
/// In steps, so that jobs of like size share an array.
constexpr std::int64_t kSpareMb = 128, kGrainMb = 64;

/// Reasons to wait that time does not mend; squeue(1), "JOB REASON CODES".
bool is_never(const std::string& reason) {
  constexpr std::array<std::string_view, 9> list{
      "BadConstraints",     "PartitionConfig", "PartitionNodeLimit",
      "PartitionTimeLimit", "InvalidAccount",  "InvalidQOS",
      "AccountNotAllowed",  "QOSNotAllowed",   "DependencyNeverSatisfied"};
  return std::find(list.begin(), list.end(), reason) != list.end();
}

}  // namespace

void check_label(const std::string& mapping) { parse_label(mapping); }

Needs needs_of(const Task& task, const SlurmEngineOptions& options) {
  Needs n;
  n.threads = std::max(1, task.threads);
  if (task.memory_mb > 0) {
    const std::int64_t mb = task.memory_mb + task.memory_mb / 16 + kSpareMb;
    n.memory_mb = (mb + kGrainMb - 1) / kGrainMb * kGrainMb;
  }
  n.time_min = time_limit_min(task.expected_s, options.time_factor);
  // Users may only be nicer than the default, so the default has room on either side: priorities
  // from 10 downwards differ. Against our own jobs only; other users' are the site's affair.
  constexpr std::int64_t middle = 1000, step = 100, nicest = 100'000;
  n.nice = static_cast<int>(
      std::clamp<std::int64_t>(middle - step * std::int64_t{task.priority}, 0, nicest));
  n.partition = options.partition;
  std::string chosen;
  for (const std::string& text : options.label_map) {
    const Mapping m = parse_label(text);
    if (std::find(task.labels.begin(), task.labels.end(), m.label) == task.labels.end()) continue;
    if (m.kind == "partition") {
      if (!chosen.empty() && chosen != m.value) {
        throw InputError(fmt::format("the labels of {} ask for the partitions {} and {}", task.name,
                                     chosen, m.value));
      }
      n.partition = chosen = m.value;
    } else if (m.kind == "gres") {
      n.gres += (n.gres.empty() ? "" : ",") + m.value;
    } else {
      n.constraint += (n.constraint.empty() ? "" : "&") + m.value;
    }
  }
  return n;
}

Cluster cluster_of(const std::vector<SlurmNode>& nodes, const std::string& partition) {
  Cluster c;
  for (const SlurmNode& n : nodes) {
    const auto& p = n.partitions;
    if (!partition.empty() && std::find(p.begin(), p.end(), partition) == p.end()) continue;
    c.nodes.push_back(n);
    // Undoes what `needs_of` adds to the worker's own limit.
    const std::int64_t worker_mb = (n.memory_mb - kSpareMb - kGrainMb) * 16 / 17;
    c.largest_memory_mb = std::max(c.largest_memory_mb, worker_mb);
    if (!n.usable) continue;
    c.cores += n.cores;
    c.idle_cores += std::max(0, n.cores - n.cores_used);
    c.largest_cores = std::max(c.largest_cores, n.cores);
  }
  if (c.nodes.empty()) {
    throw InputError(fmt::format("no node of Slurm is in the partition '{}'", partition));
  }
  return c;
}

std::string no_node_works(const Cluster& cluster) {
  if (cluster.cores > 0) return {};
  std::string text = "no node of Slurm takes work: ";
  constexpr std::size_t most = 3;
  for (std::size_t i = 0; i < std::min(most, cluster.nodes.size()); ++i) {
    const SlurmNode& n = cluster.nodes[i];
    text += fmt::format("{}{} is {}", i == 0 ? "" : "; ", n.name, n.state);
    // Leaves out who said so and when.
    if (!n.reason.empty()) text += fmt::format(" ({})", n.reason.substr(0, n.reason.find(" [")));
  }
  if (cluster.nodes.size() > most) text += fmt::format("; {} more", cluster.nodes.size() - most);
  return text;
}

std::string comment_of(const std::string& farm, const std::string& batch) {
  return kMark + farm + ":" + batch;
}

std::string batch_of(const std::string& comment, const std::string& farm) {
  const std::string prefix = kMark + farm + ":";
  return comment.starts_with(prefix) ? comment.substr(prefix.size()) : "";
}

std::string quoted(const std::string& text) {
  std::string q = "'";
  for (const char c : text) {
    if (c == '\'') {
      q += "'\\''";
    } else {
      q += c;
    }
  }
  return q + "'";
}

std::string job_name(const std::vector<std::string>& names) {
  const std::string more = names.size() > 1 ? fmt::format("+{}", names.size() - 1) : "";
  std::string name = names.empty() ? "job" : names.front();
  for (char& c : name) {
    const bool plain = (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') ||
                       c == '.' || c == '_' || c == '-';
    if (!plain) c = '_';
  }
  return name.substr(0, 40 - more.size()) + more;
}

std::vector<std::string> sbatch_arguments(const Needs& n, const Batch& batch,
                                          const BatchFolder& folder, const std::string& store,
                                          const std::string& name,
                                          const SlurmEngineOptions& options) {
  // Slurm replaces %x in names of files.
  std::string log;
  for (const char c : folder.path(batch.token)) log += c == '%' ? "%%" : std::string(1, c);
  std::string array = fmt::format("--array=0-{}", batch.tasks.size() - 1);
  if (options.throttle > 0) array += fmt::format("%{}", options.throttle);
  std::vector<std::string> a = {
      "sbatch", "--parsable", array, "--job-name=" + name,
      "--comment=" + comment_of(folder.farm(), batch.token),
      // A requeue by Slurm would run the same attempt twice; by default it would empty the log.
      "--no-requeue", "--open-mode=append", "--output=" + log + "/%a.txt", "--chdir=" + store,
      "--nodes=1", "--ntasks=1", fmt::format("--cpus-per-task={}", n.threads),
      fmt::format("--nice={}", n.nice)};
  if (n.memory_mb > 0) a.push_back(fmt::format("--mem={}M", n.memory_mb));
  if (n.time_min > 0) a.push_back(fmt::format("--time={}", n.time_min));
  const std::pair<const char*, const std::string*> texts[] = {{"--partition=", &n.partition},
                                                              {"--constraint=", &n.constraint},
                                                              {"--gres=", &n.gres},
                                                              {"--account=", &options.account},
                                                              {"--qos=", &options.qos}};
  for (const auto& [option, value] : texts) {
    if (!value->empty()) a.push_back(option + *value);
  }
  a.insert(a.end(), options.sbatch_arguments.begin(), options.sbatch_arguments.end());
  return a;
}

std::string job_script(const Batch& batch, const std::string& store, const std::string& program) {
  std::string s = "#!/bin/sh\ncase \"${SLURM_ARRAY_TASK_ID:-}\" in\n";
  for (std::size_t i = 0; i < batch.tasks.size(); ++i) {
    s += fmt::format("{}) token={} ;;\n", i, batch.tasks[i]);
  }
  s += fmt::format("*) exit {} ;;\nesac\n", static_cast<int>(script_no_folder));
  s += "folder=" + quoted(store) + "/attempts/$token\n";
  s +=
      fmt::format("[ -f \"$folder/order.json\" ] || exit {}\n", static_cast<int>(script_no_folder));
  // One start for an attempt: after a crash of its controller Slurm starts again what it forgot.
  s += fmt::format(
      "mkdir \"$folder/started\" || {{ [ -d \"$folder/started\" ] && exit {}; exit {}; }}\n",
      static_cast<int>(script_started), static_cast<int>(script_no_write));
  // exec: signals and exit codes are the worker's own.
  s += "exec " + quoted(program) + " worker \"$folder\"\n";
  return s;
}

Sightings sightings(const std::vector<SlurmJob>& jobs, const std::string& farm,
                    const std::map<std::string, int>& sizes) {
  Sightings seen;
  // Of two records of the same task the one of higher rank is kept.
  const auto rank = [](const SlurmJob& j) {
    switch (j.phase) {
      case SlurmPhase::running:
        return 4;
      case SlurmPhase::ending:
        return 3;
      case SlurmPhase::waiting:
        return 2;
      case SlurmPhase::ended:
        break;
    }
    return j.exit_code == script_started ? 0 : 1;
  };
  const auto add = [&](const std::string& batch, int task, const SlurmJob& job) {
    Sight sight{job, fmt::format("{}_{}", job.array, task)};
    const auto [at, added] = seen.tasks.try_emplace({batch, task}, sight);
    if (added) return;
    // The record of an array and that of one of its tasks have the same id: these are no doubles.
    const bool same = at->second.id == sight.id;
    const bool better = rank(job) > rank(at->second.job);
    const Sight& worse = better ? at->second : sight;
    if (!same && worse.job.phase == SlurmPhase::waiting) seen.doubles.push_back(worse.id);
    if (better) at->second = sight;
  };
  for (const SlurmJob& job : jobs) {
    const std::string batch = batch_of(job.comment, farm);
    if (batch.empty() || job.array == 0) continue;
    for (const int task : job.tasks) add(batch, task, job);
  }
  // Of a list that was cut short, tasks without a record of their own may still be waiting.
  for (const SlurmJob& job : jobs) {
    const std::string batch = batch_of(job.comment, farm);
    const auto size = sizes.find(batch);
    if (!job.more_tasks || batch.empty() || size == sizes.end()) continue;
    for (int task = 0; task < size->second; ++task) {
      if (!seen.tasks.contains({batch, task})) add(batch, task, job);
    }
  }
  return seen;
}

namespace {

/// How a task ended, by what Slurm says.
TaskReport end_report(const HeldTask& held, const Sight* sight, bool has_result) {
  TaskReport r;
  r.token = held.token;
  r.state = TaskState::ended;
  r.node = held.node;
  if (!sight) {
    if (has_result) return r;
    if (held.withdrawn) {
      r.reason = Reason::stopped;
      r.message = "taken back from Slurm before it started";
    } else if (held.cancelled_ms != 0) {
      r.reason = Reason::cancelled;
    } else {
      r.reason = Reason::lease_lost;
      r.message = "Slurm does not know job " + (held.id.empty() ? "" : held.id + " ") + "any more";
    }
    return r;
  }
  const SlurmJob& job = sight->job;
  r.exit_code = job.exit_code;
  r.signal = job.signal;
  if (has_result) return r;
  const std::string who = "Slurm job " + sight->id;
  const std::string where = job.node.empty() ? "" : " on node " + job.node;
  if (held.withdrawn && held.cancelled_ms != 0) {
    r.reason = Reason::stopped;
    r.message = "taken back from Slurm";
  } else if (held.cancelled_ms != 0) {
    r.reason = Reason::cancelled;
  } else if (job.state == "NODE_FAIL" || job.state == "BOOT_FAIL") {
    r.reason = Reason::worker_killed;
    r.message = who + ": node lost" + where;
  } else if (job.state == "OUT_OF_MEMORY") {
    r.reason = Reason::out_of_memory;
    r.message = who + ": over Slurm's memory limit" + where;
  } else if (job.state == "TIMEOUT" || job.state == "DEADLINE") {
    r.reason = Reason::hung;
    r.message = who + ": over its time limit" + where;
  } else if (job.state == "PREEMPTED" || job.state == "REVOKED") {
    r.reason = Reason::stopped;
    r.message = who + ": preempted" + where;
  } else if (job.state == "CANCELLED") {
    r.reason = Reason::worker_killed;
    r.message = who + ": cancelled in Slurm, not by us";
  } else if (job.exit_code == script_started) {
    r.reason = Reason::lease_lost;
    r.message = who + ": started twice by Slurm" + where;
  } else if (job.exit_code == script_no_folder) {
    r.reason = Reason::engine_failed;
    r.message = who + ": the store is not seen" + where + ": " + held.folder;
  } else if (job.exit_code == script_no_write) {
    r.reason = Reason::device_failed;
    r.message = who + ": the store can't be written" + where + ": " + held.folder;
  } else if (job.exit_code == 126 || job.exit_code == 127) {
    r.reason = Reason::engine_failed;
    r.message = who + ": slicefarm can't be run" + where;
  } else if (job.exit_code == 0 && job.state == "COMPLETED") {
    r.reason = Reason::output_invalid;
    r.message = who + ": ended well, but left no result" + where;
  } else if (job.exit_code <= 0 && job.signal == 0) {
    r.reason = Reason::engine_failed;
    r.message = who + ": " + job.state + (job.reason.empty() ? "" : ", " + job.reason) + where;
  } else if (job.signal != 0) {
    r.message = fmt::format("{}: ended by signal {}{}", who, job.signal, where);
  }
  return r;
}

}  // namespace

bool says_over_memory(const std::string& log_path) {
  std::ifstream in(log_path, std::ios::binary | std::ios::ate);
  constexpr std::streamoff most = 16384;
  const std::streamoff size = in.tellg();
  if (!in || size < 0) return false;
  in.seekg(std::max<std::streamoff>(0, size - most));
  for (std::string line; std::getline(in, line);) {
    if (!line.starts_with("slurmstepd")) continue;
    for (const char* text : {"exceeded memory limit", "exceeded job memory limit", "oom-kill",
                             "oom_kill", "OOM Killed"}) {
      if (line.find(text) != line.npos) return true;
    }
  }
  return false;
}

std::optional<TaskReport> judge(HeldTask& held, const Sight* sight, WorkerTrace left,
                                std::int64_t begun_ms, std::int64_t now_ms,
                                const Patience& patience) {
  if (sight) {
    held.absences = 0;
    held.id = sight->id;
    if (!sight->job.node.empty()) held.node = sight->job.node;
  }
  // A worker that has come to its end is done, whatever Slurm knows of it by now.
  if (left == WorkerTrace::result) return end_report(held, sight, true);
  // A worker that was asked to stop by somebody else is judged later: Slurm says why when it has
  // cleaned up.
  if (left == WorkerTrace::stopped && held.cancelled_ms != 0) return end_report(held, sight, true);
  const bool out_of_patience =
      held.cancelled_ms != 0 && now_ms - held.cancelled_ms >= patience.cancel_ms;
  if (!sight) {
    if (out_of_patience) return end_report(held, nullptr, false);
    if (begun_ms < held.since_ms) return std::nullopt;
    if (held.absences++ == 0) held.absent_since_ms = now_ms;
    // Tasks of arrays that are cancelled while they wait vanish at once.
    const bool gone = held.cancelled_ms != 0 && begun_ms >= held.cancelled_ms;
    const bool lost =
        held.absences >= patience.absences && now_ms - held.absent_since_ms >= patience.absent_ms;
    if (gone || lost) return end_report(held, nullptr, false);
    return std::nullopt;
  }
  const SlurmJob& job = sight->job;
  if (job.phase == SlurmPhase::ended) {
    if (held.ended_since_ms == 0) held.ended_since_ms = now_ms;
    // Whether a result may still come: not after a signal, nor when the script itself has failed.
    const bool killed =
        job.exit_code < 0 || job.exit_code >= script_no_write || job.state != "COMPLETED";
    const bool by_worker = job.exit_code >= 0 && job.exit_code < script_no_write;
    const std::int64_t wait_ms = left == WorkerTrace::stopped ? 0
                                 : !killed                    ? patience.result_ms
                                 : by_worker                  ? patience.failure_ms
                                                              : 0;
    if (held.cancelled_ms == 0 && now_ms - held.ended_since_ms < wait_ms) return std::nullopt;
    return end_report(held, sight, false);
  }
  held.ended_since_ms = 0;
  if (job.phase == SlurmPhase::waiting && is_never(job.reason)) {
    if (held.refused_since_ms == 0) held.refused_since_ms = now_ms;
    if (now_ms - held.refused_since_ms >= patience.refused_ms) {
      TaskReport r;
      r.token = held.token;
      r.state = TaskState::ended;
      r.reason = Reason::engine_failed;
      r.message = "Slurm job " + sight->id + " can't start: " + job.reason;
      return r;
    }
  } else {
    held.refused_since_ms = 0;
  }
  if (out_of_patience) return end_report(held, sight, false);
  const TaskState state =
      job.phase == SlurmPhase::waiting ? TaskState::waiting : TaskState::running;
  const std::string message =
      state == TaskState::waiting && !job.reason.empty() ? "in Slurm: " + job.reason : "";
  if (held.told && held.state == state && held.message == message) return std::nullopt;
  held.told = true;
  held.state = state;
  held.message = message;
  TaskReport r;
  r.token = held.token;
  r.state = state;
  r.node = state == TaskState::running ? held.node : "";
  r.message = message;
  return r;
}

}  // namespace slicecorr::farm::detail
