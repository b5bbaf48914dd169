// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <fmt/format.h>
#include <poll.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <limits>

#include "engine/slurm_engine.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/farm/token.hpp"

namespace slicecorr::farm {

namespace fs = std::filesystem;
using namespace detail;
using std::chrono::milliseconds;

namespace {

/// How long a submission is waited for; it goes on when it takes longer.
constexpr milliseconds kSubmitPatience{1000};
constexpr std::int64_t kNodesIntervalMs = 15'000;
/// Time between two looks at the cluster while no node takes work.
constexpr std::int64_t kNoNodesIntervalMs = 3000;
/// Time without submissions after a refusal that says "later".
constexpr std::int64_t kRefusedMs = 30'000;
/// Most tasks in an array, whatever MaxArraySize allows.
constexpr int kLargestArray = 500;

}  // namespace

SlurmEngine::SlurmEngine(const SlurmEngineOptions& options)
    : options_(options), batches_(options.store) {
  for (const std::string& mapping : options_.label_map) check_label(mapping);
  for (const std::string* path : {&options_.store, &options_.program}) {
    if (path->find_first_of("\n\\") != path->npos) {
      throw InputError(*path, "", "has a line end or backslash, which Slurm does not take");
    }
  }
  ask_cluster();
}

EngineCapacity SlurmEngine::capacity() {
  EngineCapacity r;
  r.cores = cluster_.idle_cores;
  r.largest_memory_mb = cluster_.largest_memory_mb;
  const int most =
      options_.queue_ahead > 0 ? options_.queue_ahead : 2 * std::max(1, cluster_.cores);
  // A cluster that does not answer gets no more tasks.
  if (answers_ && now() >= refused_until_) {
    r.tasks = std::max(0, most - static_cast<int>(held_.size()));
  }
  // Slurm itself sees to it that nodes have room; what never fits is found by the largest node.
  r.memory_mb = cluster_.largest_memory_mb * std::max(1, r.tasks);
  return r;
}

Engine::TaskSize SlurmEngine::share(const EngineCapacity& capacity, std::int64_t waiting,
                                    std::int64_t base_memory_mb,
                                    std::int64_t thread_memory_mb) const {
  EngineCapacity one = capacity;
  one.memory_mb = capacity.largest_memory_mb;
  TaskSize s = Engine::share(one, waiting, base_memory_mb, thread_memory_mb);
  if (s.threads > cluster_.largest_cores) {
    s.threads = std::max(1, cluster_.largest_cores);
    s.memory_mb = base_memory_mb + (s.threads - 1) * thread_memory_mb;
  }
  return s;
}

std::vector<std::string> SlurmEngine::submit(const std::vector<Task>& tasks) {
  std::vector<std::string> ids(tasks.size());
  const auto until = now() + kSubmitPatience.count();
  // Among equal priorities Slurm goes by the order of submission, and so do we.
  std::vector<std::pair<Needs, std::vector<std::size_t>>> groups;
  for (std::size_t i = 0; i < tasks.size(); ++i) {
    try {
      const Needs needs = needs_of(tasks[i], options_);
      auto group = std::find_if(groups.begin(), groups.end(),
                                [&](const auto& g) { return g.first == needs; });
      if (group == groups.end()) group = groups.insert(groups.end(), {needs, {}});
      group->second.push_back(i);
    } catch (const InputError& e) {
      failed_.push_back(failure(tasks[i].token, Reason::engine_failed, e.what()));
    }
  }
  for (const auto& [needs, members] : groups) {
    for (std::size_t at = 0; at < members.size(); at += static_cast<std::size_t>(array_limit_)) {
      const std::size_t end = std::min(members.size(), at + static_cast<std::size_t>(array_limit_));
      submit_batch(
          needs, tasks,
          {members.begin() + static_cast<long>(at), members.begin() + static_cast<long>(end)});
      while (!submissions_.empty() && now() < until) {
        submissions_.front()->command.wait(milliseconds(until - now()));
        take_submissions();
      }
    }
  }
  for (std::size_t i = 0; i < tasks.size(); ++i) {
    const auto held = held_.find(tasks[i].token);
    if (held == held_.end()) continue;
    ids[i] = held->second.id.empty()
                 ? fmt::format("{}/{}", held->second.place.first, held->second.place.second)
                 : held->second.id;
  }
  return ids;
}

std::vector<TaskReport> SlurmEngine::poll() {
  std::vector<TaskReport> reports = std::exchange(failed_, {});
  take_submissions();
  std::erase_if(orders_, [this](const std::unique_ptr<Command>& c) {
    if (!c->done()) return false;
    listing_due_ = 0;  // list at once, to see what came of it
    return true;
  });
  take_nodes();
  take_listing(reports);
  force_cancelled();
  start_listing();
  sweep();
  for (TaskReport& r : std::exchange(failed_, {})) reports.push_back(std::move(r));
  return reports;
}

void SlurmEngine::wait(milliseconds most, int wake_fd) {
  std::vector<pollfd> fds;
  const auto add = [&](const Command* c) {
    if (!c) return;
    for (const int fd : c->descriptors()) fds.push_back({fd, POLLIN, 0});
    // A command that has closed its outputs ends any moment.
    if (c->descriptors().empty()) most = std::min(most, milliseconds(2));
  };
  if (wake_fd >= 0) fds.push_back({wake_fd, POLLIN, 0});
  add(listing_.get());
  add(node_listing_.get());
  for (const auto& s : submissions_) add(&s->command);
  for (const auto& c : orders_) add(c.get());
  if (!listing_ && !held_.empty()) {
    const std::int64_t due = std::clamp<std::int64_t>(listing_due_ - now(), 0, most.count());
    most = milliseconds(due);
  }
  ::poll(fds.data(), fds.size(), static_cast<int>(most.count()));
}

void SlurmEngine::cancel(const std::vector<std::string>& tokens) {
  std::vector<std::string> waiting, running;
  for (const std::string& token : tokens) {
    const auto found = held_.find(token);
    if (found == held_.end() || found->second.cancelled_ms != 0) continue;
    HeldTask& h = found->second;
    h.cancelled_ms = now();
    if (h.id.empty()) continue;
    // A job that Slurm is ending takes no more signals, and SIGKILL comes after its KillWait of
    // 30 s only. So workers that run are signalled by us.
    std::error_code error;
    h.signalled = h.state == TaskState::running || fs::exists(h.folder + "/started", error);
    (h.signalled ? running : waiting).push_back(h.id);
  }
  scancel(waiting);
  scancel(running, "TERM");
}

void SlurmEngine::withdraw() {
  std::vector<std::string> ids;
  for (auto& [token, h] : held_) {
    // Only tasks that Slurm said to be waiting. One that starts this very moment is stopped, and
    // queued again.
    if (!h.told || h.state != TaskState::waiting || h.cancelled_ms != 0 || h.id.empty()) continue;
    h.cancelled_ms = now();
    h.withdrawn = true;
    ids.push_back(h.id);
  }
  scancel(ids);
}

void SlurmEngine::tidy(bool last) {
  std::erase_if(ending_batches_, [this](const std::string& batch) {
    if (is_submitting(batch)) return false;
    // A batch with open attempts is looked at again when the last of them ends.
    if (!is_held(batch) && batches_.has_ended(batch)) batches_.remove(batch);
    return true;
  });
  if (last) remove_ended_batches();
}

void SlurmEngine::forget(const std::vector<std::string>& tokens) {
  for (const std::string& token : tokens) held_.erase(token);
}

std::vector<std::string> SlurmEngine::adopt(const std::vector<Attempt>& attempts) {
  std::map<std::string, TaskPlace> places;
  for (const Batch& batch : batches_.read_all()) {
    for (std::size_t i = 0; i < batch.tasks.size(); ++i) {
      places[batch.tasks[i]] = {batch.token, static_cast<int>(i)};
    }
    sizes_[batch.token] = static_cast<int>(batch.tasks.size());
  }
  std::vector<std::string> known;
  for (const Attempt& a : attempts) {
    const auto place = places.find(a.token);
    // The attempt never came to Slurm, or its end was recorded.
    if (place == places.end()) continue;
    HeldTask h;
    h.token = a.token;
    h.folder = options_.store + "/attempts/" + a.token;
    h.place = place->second;
    h.since_ms = now();
    held_[a.token] = std::move(h);
    known.push_back(a.token);
  }
  listing_due_ = 0;
  return known;
}

std::string SlurmEngine::trouble() const {
  return answers_ ? no_node_works(cluster_) : "no answer from Slurm: " + complaint_;
}

std::vector<FarmNode> SlurmEngine::nodes() {
  std::vector<FarmNode> list;
  for (const SlurmNode& n : cluster_.nodes) {
    FarmNode node;
    node.name = n.name;
    node.state = n.state;
    node.usable = n.usable;
    node.cores = n.cores;
    node.cores_used = n.cores_used;
    node.memory_mb = n.memory_mb;
    node.memory_used_mb = n.memory_used_mb;
    node.labels = n.features;
    node.labels.insert(node.labels.end(), n.gres.begin(), n.gres.end());
    list.push_back(std::move(node));
  }
  return list;
}

TaskReport SlurmEngine::failure(const std::string& token, Reason reason,
                                const std::string& message) {
  TaskReport r;
  r.token = token;
  r.state = TaskState::ended;
  r.reason = reason;
  r.message = message;
  return r;
}

void SlurmEngine::ask_cluster() {
  const CommandResult config = run_command({"scontrol", "show", "config"}, kCommandLimit);
  const CommandResult nodes = run_command(nodes_command(), kCommandLimit);
  for (const CommandResult* r : {&config, &nodes}) {
    if (!r->ok()) throw DeviceError("scontrol: " + r->complaint());
  }
  const auto values = parse_config(config.out);
  if (const auto at = values.find("MaxArraySize"); at != values.end()) {
    // MaxArraySize is 1 more than the greatest number of a task.
    array_limit_ = std::clamp(std::atoi(at->second.c_str()), 1, kLargestArray);
  }
  cluster_ = cluster_of(parse_nodes(nodes.out), options_.partition);
  nodes_due_ = now() + kNoNodesIntervalMs;
}

void SlurmEngine::take_nodes() {
  if (node_listing_ && node_listing_->done()) {
    const CommandResult& r = node_listing_->result();
    try {
      if (r.ok()) cluster_ = cluster_of(parse_nodes(r.out), options_.partition);
    } catch (const Error&) {
      // The nodes that were told last hold until there is another answer.
    }
    node_listing_.reset();
    nodes_due_ = now() + (cluster_.cores > 0 ? kNodesIntervalMs : kNoNodesIntervalMs);
  }
  if (!node_listing_ && now() >= nodes_due_) {
    node_listing_ = std::make_unique<Command>(nodes_command(), kCommandLimit);
  }
}

void SlurmEngine::submit_batch(const Needs& needs, const std::vector<Task>& tasks,
                               const std::vector<std::size_t>& members) {
  Batch batch;
  batch.token = random_token();
  std::vector<std::string> names;
  for (const std::size_t i : members) {
    batch.tasks.push_back(tasks[i].token);
    names.push_back(tasks[i].name);
  }
  try {
    batches_.write(batch);
  } catch (const DeviceError& e) {
    for (const std::string& t : batch.tasks) {
      failed_.push_back(failure(t, Reason::disk_full, e.what()));
    }
    batches_.remove(batch.token);
    return;
  }
  sizes_[batch.token] = static_cast<int>(batch.tasks.size());
  for (std::size_t i = 0; i < batch.tasks.size(); ++i) {
    HeldTask h;
    h.token = batch.tasks[i];
    h.folder = tasks[members[i]].folder;
    h.place = {batch.token, static_cast<int>(i)};
    // Until sbatch has answered, no listing says anything of it.
    h.since_ms = std::numeric_limits<std::int64_t>::max();
    held_[h.token] = std::move(h);
  }
  submissions_.push_back(std::make_unique<Submission>(
      batch.token,
      sbatch_arguments(needs, batch, batches_, options_.store, job_name(names), options_),
      job_script(batch, options_.store, options_.program)));
}

void SlurmEngine::take_submissions() {
  for (auto at = submissions_.begin(); at != submissions_.end();) {
    if (!(*at)->command.done()) {
      ++at;
      continue;
    }
    judge_submission(**at);
    at = submissions_.erase(at);
    listing_due_ = std::min(listing_due_, now() + kHastyMs);
  }
}

void SlurmEngine::judge_submission(const Submission& s) {
  const CommandResult& r = s.command.result();
  std::int64_t id = 0;
  std::string complaint;
  if (r.ok()) {
    try {
      id = parse_sbatch(r.out);
    } catch (const DeviceError& e) {
      complaint = e.what();
    }
  } else {
    complaint = r.complaint();
  }
  const Refusal refusal = id != 0 ? Refusal::unsure : refusal_of(complaint);
  if (id == 0 && refusal != Refusal::for_good) refused_until_ = now() + kRefusedMs;
  std::vector<std::string> cancelled;
  for (auto h = held_.begin(); h != held_.end();) {
    if (h->second.place.first != s.batch) {
      ++h;
      continue;
    }
    if (id != 0 || refusal == Refusal::unsure) {
      // Without an answer the batch may be in Slurm or not: listings will tell.
      h->second.since_ms = now();
      if (id != 0) h->second.id = fmt::format("{}_{}", id, h->second.place.second);
      if (id != 0 && h->second.cancelled_ms != 0) cancelled.push_back(h->second.id);
      ++h;
      continue;
    }
    failed_.push_back(refusal == Refusal::later
                          ? failure(h->first, Reason::stopped, "Slurm takes no more: " + complaint)
                          : failure(h->first, Reason::engine_failed, "sbatch: " + complaint));
    h = held_.erase(h);
  }
  if (id == 0 && refusal != Refusal::unsure) {
    batches_.remove(s.batch);
    sizes_.erase(s.batch);
  }
  scancel(cancelled);
}

std::unique_ptr<Engine> make_slurm_engine(const SlurmEngineOptions& options) {
  return std::make_unique<SlurmEngine>(options);
}

}  // namespace slicecorr::farm
