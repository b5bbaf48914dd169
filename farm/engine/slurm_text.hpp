// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file slurm_text.hpp
/// What Slurm's commands print, read strictly: an answer that is not whole or not understood is no
/// answer. All functions throw `DeviceError` then, naming the command.
///
/// `squeue --json` gives exit code 0 and an empty list of jobs when no controller answers; only its
/// list of errors tells (seen with 22.05). Taken for the truth, that empty list would mean that
/// everything has ended.
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <vector>

namespace slicecorr::farm::detail {

/// What a job of Slurm is doing, as far as an engine cares.
enum class SlurmPhase {
  waiting,  ///< PENDING and the like
  running,
  ending,  ///< COMPLETING: the work is done or killed, cleaning up is not
  ended,
};

/// A record of squeue: a job, a task of an array, or all tasks of an array that wait.
struct SlurmJob {
  std::int64_t id = 0;      ///< each task that has started has one of its own
  std::int64_t array = 0;   ///< number of the array; 0: none
  std::vector<int> tasks;   ///< of the array; empty: it is none, or its last task has gone
  bool more_tasks = false;  ///< the list was cut short
  SlurmPhase phase = SlurmPhase::waiting;
  std::string state;   ///< "RUNNING"
  std::string reason;  ///< "Resources"; "" for none
  std::string comment, node, name;
  int exit_code = -1;  ///< ended: -1 when a signal ended it
  int signal = 0;
};

/// `squeue --json --states=all`, of Slurm 22.05 and of newer ones that give numbers as objects and
/// states as lists.
std::vector<SlurmJob> parse_squeue(const std::string& text);

/// "1-2,5,8-12:2%4" to its numbers. `more`: the text was cut ("...").
std::vector<int> parse_task_list(const std::string& text, bool& more);

/// The job id of `sbatch --parsable`: "57" or "57;cluster".
std::int64_t parse_sbatch(const std::string& text);

/// What a failed sbatch means.
enum class Refusal {
  unsure,    ///< the controller did not answer: it may have the job or not
  later,     ///< a limit is reached, or it is not ready: the same may be taken later
  for_good,  ///< it will never take this
};
Refusal refusal_of(const std::string& complaint);

/// "NAME=value" fields of one line of `scontrol -o show ...`. Values may hold spaces: a field
/// begins where a word of letters, digits and ":/[]_-" before an equals sign does.
std::map<std::string, std::string> parse_fields(const std::string& line);

/// A node of `scontrol -o show node`.
struct SlurmNode {
  std::string name, state;  ///< state as Slurm says it: "IDLE+DRAIN"
  std::string reason;       ///< why it is not used: "to be mended [root@2026-03-01T20:00:00]"
  bool usable = true;
  int cores = 0, cores_used = 0;
  std::int64_t memory_mb = 0, memory_used_mb = 0;
  std::vector<std::string> partitions, features, gres;
};
std::vector<SlurmNode> parse_nodes(const std::string& text);

/// Lines "NAME = value" of `scontrol show config`.
std::map<std::string, std::string> parse_config(const std::string& text);

}  // namespace slicecorr::farm::detail
