// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "engine/slurm_text.hpp"

#include <fmt/format.h>
#include <sys/wait.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <charconv>
#include <nlohmann/json.hpp>
#include <sstream>
#include <string_view>

#include "slicecorr/error.hpp"
#include "support/json/read_json.hpp"

namespace slicecorr::farm::detail {

namespace {

using Json = nlohmann::json;

[[noreturn]] void not_understood(const std::string& command, const std::string& what) {
  throw DeviceError(fmt::format("{}: {}", command, what));
}

std::int64_t whole(const std::string& command, std::string_view text) {
  std::int64_t value = 0;
  const auto [at, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || at != text.data() + text.size() || value < 0) {
    not_understood(command, fmt::format("'{}' is no number", text));
  }
  return value;
}

/// A number, or {"set": .., "infinite": .., "number": ..}; `none` where it is not set.
std::int64_t number(const Json& record, const char* name, std::int64_t none) {
  const auto at = record.find(name);
  if (at == record.end() || at->is_null()) return none;
  if (at->is_number_integer()) return at->get<std::int64_t>();
  if (at->is_object()) {
    const auto set = at->find("set"), value = at->find("number");
    if (set != at->end() && set->is_boolean() && !set->get<bool>()) return none;
    if (value != at->end() && value->is_number_integer()) return value->get<std::int64_t>();
  }
  not_understood("squeue", fmt::format("'{}' is no number", name));
}

std::string text_of(const Json& record, const char* name) {
  const auto at = record.find(name);
  if (at == record.end() || at->is_null()) return {};
  if (!at->is_string()) not_understood("squeue", fmt::format("'{}' is no text", name));
  return at->get<std::string>();
}

struct StateRow {
  const char* name;
  SlurmPhase phase;
};
// squeue(1), "JOB STATE CODES".
constexpr std::array<StateRow, 27> kStates{{
    {"PENDING", SlurmPhase::waiting},       {"CONFIGURING", SlurmPhase::waiting},
    {"REQUEUED", SlurmPhase::waiting},      {"REQUEUE_HOLD", SlurmPhase::waiting},
    {"REQUEUE_FED", SlurmPhase::waiting},   {"SPECIAL_EXIT", SlurmPhase::waiting},
    {"RESV_DEL_HOLD", SlurmPhase::waiting}, {"POWER_UP_NODE", SlurmPhase::waiting},
    {"EXPEDITING", SlurmPhase::waiting},    {"RUNNING", SlurmPhase::running},
    {"SUSPENDED", SlurmPhase::running},     {"STOPPED", SlurmPhase::running},
    {"SIGNALING", SlurmPhase::running},     {"RESIZING", SlurmPhase::running},
    {"STAGE_OUT", SlurmPhase::running},     {"COMPLETING", SlurmPhase::ending},
    {"COMPLETED", SlurmPhase::ended},       {"FAILED", SlurmPhase::ended},
    {"CANCELLED", SlurmPhase::ended},       {"TIMEOUT", SlurmPhase::ended},
    {"NODE_FAIL", SlurmPhase::ended},       {"OUT_OF_MEMORY", SlurmPhase::ended},
    {"BOOT_FAIL", SlurmPhase::ended},       {"DEADLINE", SlurmPhase::ended},
    {"PREEMPTED", SlurmPhase::ended},       {"REVOKED", SlurmPhase::ended},
    {"LAUNCH_FAILED", SlurmPhase::ended},
}};

SlurmPhase phase_of(const std::string& state) {
  for (const StateRow& row : kStates) {
    if (state == row.name) return row.phase;
  }
  // A state of a newer Slurm counts as running: neither given up nor believed to be done.
  return SlurmPhase::running;
}

void read_state(const Json& record, SlurmJob& job) {
  const auto at = record.find("job_state");
  if (at != record.end() && at->is_string()) {
    job.state = at->get<std::string>();
    job.phase = phase_of(job.state);
    return;
  }
  if (at == record.end() || !at->is_array() || at->empty()) {
    not_understood("squeue", "a job has no job_state");
  }
  // The state first, then flags: ["CANCELLED", "COMPLETING"].
  bool first = true;
  for (const Json& s : *at) {
    if (!s.is_string()) not_understood("squeue", "a job_state is no text");
    const std::string name = s.get<std::string>();
    const SlurmPhase phase = phase_of(name);
    if (first) job.state = name;
    if (first || phase == SlurmPhase::ending || phase == SlurmPhase::waiting) job.phase = phase;
    first = false;
  }
}

void read_exit(const Json& record, SlurmJob& job) {
  const auto at = record.find("exit_code");
  if (at != record.end() && at->is_object() && at->contains("return_code")) {
    job.exit_code = static_cast<int>(number(*at, "return_code", -1));
    const auto signal = at->find("signal");
    if (signal != at->end() && signal->is_object()) {
      job.signal =
          static_cast<int>(number(*signal, signal->contains("signal_id") ? "signal_id" : "id", 0));
    }
    if (job.signal != 0) job.exit_code = -1;
    return;
  }
  const std::int64_t status = number(record, "exit_code", -1);
  if (status < 0) return;
  const int s = static_cast<int>(status);
  if (WIFSIGNALED(s)) {
    job.signal = WTERMSIG(s);
  } else {
    job.exit_code = WEXITSTATUS(s);
  }
}

std::vector<std::string> split(const std::string& text, char by) {
  std::vector<std::string> parts;
  if (text.empty() || text == "(null)") return parts;
  int depth = 0;
  std::string part;
  for (const char c : text) {
    if (c == '(' || c == '[') ++depth;
    if (c == ')' || c == ']') --depth;
    if (c == by && depth == 0) {
      parts.push_back(part);
      part.clear();
    } else {
      part += c;
    }
  }
  parts.push_back(part);
  return parts;
}

}  // namespace

std::vector<int> parse_task_list(const std::string& text, bool& more) {
  more = false;
  std::vector<int> tasks;
  std::string list = text.substr(0, text.find('%'));
  if (list.ends_with("...")) {
    more = true;
    // The number before the dots may be cut, too.
    const std::size_t comma = list.rfind(',');
    list = comma == list.npos ? "" : list.substr(0, comma);
  }
  for (const std::string& part : split(list, ',')) {
    const std::size_t dash = part.find('-');
    const std::size_t colon = part.find(':');
    const std::int64_t first = whole("squeue", std::string_view(part).substr(0, dash));
    std::int64_t last = first, step = 1;
    if (dash != part.npos) {
      last = whole("squeue", std::string_view(part).substr(
                                 dash + 1, colon == part.npos ? part.npos : colon - dash - 1));
      if (colon != part.npos) step = whole("squeue", std::string_view(part).substr(colon + 1));
    }
    // The largest MaxArraySize that Slurm takes is 4000001.
    if (step < 1 || last < first || last > 4'000'001) {
      not_understood("squeue", fmt::format("'{}' is no list of tasks", text));
    }
    for (std::int64_t i = first; i <= last; i += step) tasks.push_back(static_cast<int>(i));
  }
  return tasks;
}

std::vector<SlurmJob> parse_squeue(const std::string& text) {
  const Json root = slicecorr::detail::try_json<Json>(text, slicecorr::detail::kManyLayers);
  if (root.is_discarded() || !root.is_object()) {
    not_understood("squeue --json", "the answer is no whole JSON");
  }
  const auto errors = root.find("errors");
  if (errors != root.end() && !errors->empty()) {
    const Json& first = errors->is_array() ? errors->front() : *errors;
    std::string why = "an error";
    if (first.is_object()) {
      for (const char* key : {"error", "description"}) {
        if (first.contains(key) && first[key].is_string()) why = first[key].get<std::string>();
      }
    }
    not_understood("squeue --json", why);
  }
  const auto jobs = root.find("jobs");
  if (jobs == root.end() || !jobs->is_array()) {
    not_understood("squeue --json", "the answer has no jobs");
  }
  std::vector<SlurmJob> list;
  list.reserve(jobs->size());
  for (const Json& record : *jobs) {
    if (!record.is_object()) not_understood("squeue --json", "a job is no object");
    SlurmJob job;
    job.id = number(record, "job_id", -1);
    if (job.id <= 0) not_understood("squeue --json", "a job has no job_id");
    job.comment = text_of(record, "comment");
    job.array = number(record, "array_job_id", 0);
    const std::int64_t task = number(record, "array_task_id", -1);
    if (job.array != 0 && task >= 0) {
      job.tasks.push_back(static_cast<int>(task));
    } else if (job.array != 0) {
      job.tasks = parse_task_list(text_of(record, "array_task_string"), job.more_tasks);
    }
    read_state(record, job);
    job.reason = text_of(record, "state_reason");
    if (job.reason == "None") job.reason.clear();
    job.node = text_of(record, "nodes");
    job.name = text_of(record, "name");
    if (job.phase == SlurmPhase::ended) read_exit(record, job);
    list.push_back(std::move(job));
  }
  return list;
}

std::int64_t parse_sbatch(const std::string& text) {
  std::string line = text.substr(0, text.find('\n'));
  line = line.substr(0, line.find(';'));
  const std::int64_t id = whole("sbatch", line);
  if (id == 0) not_understood("sbatch", "gave no job id");
  return id;
}

Refusal refusal_of(const std::string& complaint) {
  const auto says = [&](std::initializer_list<const char*> texts) {
    return std::any_of(texts.begin(), texts.end(),
                       [&](const char* t) { return complaint.find(t) != complaint.npos; });
  };
  if (says({"no answer in time", "Unable to contact slurm controller", "Socket timed out",
            "Connection refused", "Transport endpoint", "Zero Bytes were transmitted",
            "Communication connection failure", "Message receive failure", "standby mode",
            "Unspecified error", "no number", "gave no job id"})) {
    return Refusal::unsure;
  }
  if (says({"temporarily unable", "temporarily unavailable", "temporarily disabled", "submit limit",
            "MaxJobCount", "JobLimit", "MaxSubmit", "in progress", "AssocGrp", "QOSGrp",
            "violates accounting/QOS policy", "credential", "No space left"})) {
    return Refusal::later;
  }
  return Refusal::for_good;
}

std::map<std::string, std::string> parse_fields(const std::string& line) {
  // Finds where fields begin: a space, a name, an equals sign.
  const auto in_name = [](char c) {
    return std::isalnum(static_cast<unsigned char>(c)) ||
           std::string_view(":/[]_-").find(c) != std::string_view::npos;
  };
  std::vector<std::pair<std::size_t, std::size_t>> names;
  for (std::size_t at = 0; at < line.size();) {
    std::size_t end = at;
    while (end < line.size() && in_name(line[end])) ++end;
    if (end > at && end < line.size() && line[end] == '=') names.emplace_back(at, end);
    at = line.find(' ', end);
    if (at == line.npos) break;
    ++at;
  }
  std::map<std::string, std::string> fields;
  for (std::size_t i = 0; i < names.size(); ++i) {
    const auto [begin, equals] = names[i];
    const std::size_t end = i + 1 < names.size() ? names[i + 1].first : line.size();
    std::string value = line.substr(equals + 1, end - equals - 1);
    while (!value.empty() && (value.back() == ' ' || value.back() == '\n')) value.pop_back();
    fields.emplace(line.substr(begin, equals - begin), std::move(value));
  }
  return fields;
}

std::vector<SlurmNode> parse_nodes(const std::string& text) {
  std::vector<SlurmNode> nodes;
  std::istringstream lines(text);
  for (std::string line; std::getline(lines, line);) {
    if (line.find_first_not_of(' ') == line.npos) continue;
    auto fields = parse_fields(line);
    const auto need = [&](const char* name) {
      const auto at = fields.find(name);
      if (at == fields.end()) {
        not_understood("scontrol show node", fmt::format("a node has no {}", name));
      }
      return at->second;
    };
    SlurmNode node;
    node.name = need("NodeName");
    node.state = need("State");
    node.cores = static_cast<int>(whole("scontrol show node", need("CPUTot")));
    // Cores that Slurm keeps for the system don't run jobs.
    if (fields.contains("CPUEfctv")) {
      node.cores = static_cast<int>(whole("scontrol show node", fields["CPUEfctv"]));
    }
    node.cores_used = static_cast<int>(whole("scontrol show node", need("CPUAlloc")));
    node.memory_mb = whole("scontrol show node", need("RealMemory"));
    node.memory_used_mb = whole("scontrol show node", need("AllocMem"));
    node.partitions = split(fields["Partitions"], ',');
    node.features = split(fields["ActiveFeatures"], ',');
    node.gres = split(fields["Gres"], ',');
    node.reason = fields["Reason"];
    // A star means that the node does not answer. Powered down nodes are usable: Slurm starts them
    // when they are needed.
    for (const char* bad :
         {"DOWN", "DRAIN", "FAIL", "NOT_RESPONDING", "MAINT", "*", "UNKNOWN", "FUTURE", "REBOOT"}) {
      if (node.state.find(bad) != node.state.npos) node.usable = false;
    }
    nodes.push_back(std::move(node));
  }
  return nodes;
}

std::map<std::string, std::string> parse_config(const std::string& text) {
  std::map<std::string, std::string> values;
  std::istringstream lines(text);
  for (std::string line; std::getline(lines, line);) {
    const std::size_t equals = line.find(" = ");
    if (equals == line.npos) continue;
    std::string name = line.substr(0, equals);
    while (!name.empty() && name.back() == ' ') name.pop_back();
    values[name] = line.substr(equals + 3);
  }
  if (!values.contains("SLURM_VERSION")) {
    not_understood("scontrol show config", "the answer has no SLURM_VERSION");
  }
  return values;
}

}  // namespace slicecorr::farm::detail
