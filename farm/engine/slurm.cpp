// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// The engine that gives tasks to a Slurm cluster, through its commands. Nothing blocks for longer
// than a moment: commands run beside, and their answers are taken when they are there.

#include <fmt/format.h>
#include <poll.h>

#include <algorithm>
#include <csignal>
#include <filesystem>
#include <limits>
#include <list>
#include <map>
#include <memory>
#include <set>

#include "engine/slurm_tasks.hpp"
#include "engine/slurm_text.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/farm/clock.hpp"
#include "slicecorr/farm/engine.hpp"
#include "slicecorr/farm/token.hpp"
#include "slicecorr/farm/work.hpp"
#include "support/process/command.hpp"

namespace slicecorr::farm {

namespace fs = std::filesystem;
using namespace detail;
using std::chrono::milliseconds;

namespace {

/// Slurm's commands give up by themselves, by default after MessageTimeout (10 s) and some tries.
constexpr milliseconds kCommandLimit{60'000};
/// How long a submission is waited for; it goes on when it takes longer.
constexpr milliseconds kSubmitPatience{1000};
/// Time between listings while something is being cancelled, since a user waits for it.
constexpr std::int64_t kHastyMs = 250;
/// After this, a worker that was asked to end is killed.
constexpr std::int64_t kForceMs = 1000;
constexpr std::int64_t kNodesIntervalMs = 15'000;
/// Time between two looks at the cluster while no node takes work.
constexpr std::int64_t kNoNodesIntervalMs = 3000;
/// Time without submissions after a refusal that says "later".
constexpr std::int64_t kRefusedMs = 30'000;
/// A job in Slurm that no service waits for is cancelled after this time.
constexpr std::int64_t kStrayMs = 10'000;
constexpr std::int64_t kSweepIntervalMs = 60'000;
/// Most tasks in an array, whatever MaxArraySize allows.
constexpr int kLargestArray = 500;

class SlurmEngine : public Engine {
 public:
  explicit SlurmEngine(const SlurmEngineOptions& options)
      : options_(options), batches_(options.store) {
    for (const std::string& mapping : options_.label_map) check_label(mapping);
    for (const std::string* path : {&options_.store, &options_.program}) {
      if (path->find_first_of("\n\\") != path->npos) {
        throw InputError(*path, "", "has a line end or backslash, which Slurm does not take");
      }
    }
    ask_cluster();
  }

  std::string name() const override { return "slurm"; }
  bool outlives_service() const override { return true; }

  EngineCapacity capacity() override {
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

  TaskSize share(const EngineCapacity& capacity, std::int64_t waiting, std::int64_t base_memory_mb,
                 std::int64_t thread_memory_mb) const override {
    EngineCapacity one = capacity;
    one.memory_mb = capacity.largest_memory_mb;
    TaskSize s = Engine::share(one, waiting, base_memory_mb, thread_memory_mb);
    if (s.threads > cluster_.largest_cores) {
      s.threads = std::max(1, cluster_.largest_cores);
      s.memory_mb = base_memory_mb + (s.threads - 1) * thread_memory_mb;
    }
    return s;
  }

  std::vector<std::string> submit(const std::vector<Task>& tasks) override {
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
        const std::size_t end =
            std::min(members.size(), at + static_cast<std::size_t>(array_limit_));
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

  std::vector<TaskReport> poll() override {
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

  void wait(milliseconds most, int wake_fd) override {
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

  void cancel(const std::vector<std::string>& tokens) override {
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

  void withdraw() override {
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

  void tidy(bool last) override {
    std::erase_if(ending_batches_, [this](const std::string& batch) {
      if (is_submitting(batch)) return false;
      // A batch with open attempts is looked at again when the last of them ends.
      if (!is_held(batch) && batches_.has_ended(batch)) batches_.remove(batch);
      return true;
    });
    if (last) remove_ended_batches();
  }

  void forget(const std::vector<std::string>& tokens) override {
    for (const std::string& token : tokens) held_.erase(token);
  }

  std::vector<std::string> adopt(const std::vector<Attempt>& attempts) override {
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

  std::string trouble() const override {
    return answers_ ? no_node_works(cluster_) : "no answer from Slurm: " + complaint_;
  }

  std::vector<FarmNode> nodes() override {
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

 private:
  struct Submission {
    Submission(std::string batch_token, const std::vector<std::string>& arguments,
               const std::string& script)
        : batch(std::move(batch_token)), command(arguments, kCommandLimit, script) {}
    std::string batch;
    Command command;
  };

  static std::int64_t now() { return system_clock().steady_ms(); }

  static TaskReport failure(const std::string& token, Reason reason, const std::string& message) {
    TaskReport r;
    r.token = token;
    r.state = TaskState::ended;
    r.reason = reason;
    r.message = message;
    return r;
  }

  // --- the cluster ------------------------------------------------------------------------------

  static std::vector<std::string> nodes_command() { return {"scontrol", "-o", "show", "node"}; }

  /// Asks for the cluster at the start; throws when it does not answer, as nothing can run then.
  void ask_cluster() {
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

  void take_nodes() {
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

  // --- submitting -------------------------------------------------------------------------------

  void submit_batch(const Needs& needs, const std::vector<Task>& tasks,
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

  void take_submissions() {
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

  void judge_submission(const Submission& s) {
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
      failed_.push_back(
          refusal == Refusal::later
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

  // --- listings ---------------------------------------------------------------------------------

  void start_listing() {
    if (listing_ || now() < listing_due_ || (held_.empty() && now() < idle_listing_due_)) return;
    listing_begun_ = now();
    // All jobs in one question. By default squeue cuts lists of tasks at 64 characters.
    listing_ = std::make_unique<Command>(
        std::vector<std::string>{"squeue", "--json", "--states=all", "--me"}, kCommandLimit, "",
        std::vector<std::string>{"SLURM_BITSTR_LEN=0"});
  }

  void take_listing(std::vector<TaskReport>& reports) {
    if (!listing_ || !listing_->done()) return;
    const std::unique_ptr<Command> done = std::move(listing_);
    const auto took_ms = static_cast<std::int64_t>(done->seconds() * 1000);
    // A controller that is slow is asked less often: at most a twentieth of its time is ours.
    const std::int64_t rest =
        std::max({static_cast<std::int64_t>(options_.poll_s * 1000), 19 * took_ms});
    listing_due_ = now() + (any_cancelled() ? std::min(rest, kHastyMs) : rest);
    try {
      if (!done->result().ok()) throw DeviceError("squeue: " + done->result().complaint());
      const Sightings seen = sightings(parse_squeue(done->result().out), batches_.farm(), sizes_);
      answers_ = true;
      complaint_.clear();
      judge_all(&seen, reports);
      end_strays(seen);
      listed_ = true;
      idle_listing_due_ = now() + (strays_.empty() ? kSweepIntervalMs : rest);
    } catch (const DeviceError& e) {
      // No answer says nothing of any task, but workers may have come to their ends.
      answers_ = false;
      complaint_ = e.what();
      idle_listing_due_ = now() + rest;
      judge_all(nullptr, reports);
    }
  }

  bool any_cancelled() const {
    return std::any_of(held_.begin(), held_.end(),
                       [](const auto& h) { return h.second.cancelled_ms != 0; });
  }

  WorkerTrace left_by(const HeldTask& h) const {
    // Reading the folder's list makes network file systems look at the server, not at memory.
    std::error_code error;
    bool there = false;
    for (const auto& entry : fs::directory_iterator(h.folder, error)) {
      there = there || entry.path().filename() == "result.json";
    }
    if (!there) return WorkerTrace::nothing;
    const auto outcome = read_outcome(h.folder);
    if (!outcome) return WorkerTrace::nothing;
    return outcome->reason == Reason::stopped ? WorkerTrace::stopped : WorkerTrace::result;
  }

  void judge_all(const Sightings* seen, std::vector<TaskReport>& reports) {
    for (auto at = held_.begin(); at != held_.end();) {
      HeldTask& h = at->second;
      const Sight* sight = nullptr;
      if (seen) {
        const auto found = seen->tasks.find(h.place);
        if (found != seen->tasks.end()) sight = &found->second;
      }
      const bool may_have_run = !sight || sight->job.phase != SlurmPhase::waiting;
      const WorkerTrace left = may_have_run ? left_by(h) : WorkerTrace::nothing;
      const std::string id = h.id;
      std::optional<TaskReport> report;
      if (seen || left == WorkerTrace::result || out_of_patience(h)) {
        // Without an answer "not listed" means nothing.
        const std::int64_t begun = seen ? listing_begun_ : -1;
        report = judge(h, sight, left, begun, now(), patience_);
      }
      // The task was to be cancelled before its id in Slurm was known; now it is.
      if (sight && id.empty() && h.cancelled_ms != 0 && sight->job.phase != SlurmPhase::ended) {
        scancel({h.id});
      }
      const bool ended = report && report->state == TaskState::ended;
      const bool killed = report && report->reason == Reason::none && report->signal == SIGKILL;
      if (ended && killed && left == WorkerTrace::nothing &&
          says_over_memory(h.folder + "/log.txt")) {
        report->reason = Reason::out_of_memory;
        report->message = "Slurm job " + h.id + ": over Slurm's memory limit";
      }
      if (report) reports.push_back(std::move(*report));
      if (ended) {
        ended_.insert(h.place);
        ending_batches_.insert(h.place.first);
        at = held_.erase(at);
      } else {
        ++at;
      }
    }
  }

  bool out_of_patience(const HeldTask& h) const {
    return h.cancelled_ms != 0 && now() - h.cancelled_ms >= patience_.cancel_ms;
  }

  /// Jobs of this farm in Slurm that nobody waits for: cancelled ones that a controller forgot to
  /// have cancelled, attempts that were given up while Slurm did not answer, and doubles.
  void end_strays(const Sightings& seen) {
    std::vector<std::string> ids = seen.doubles;
    std::map<std::string, std::optional<Batch>> known;
    std::map<TaskPlace, std::int64_t> strays;
    std::set<TaskPlace> held;
    for (const auto& [token, h] : held_) held.insert(h.place);
    for (const auto& [place, sight] : seen.tasks) {
      const SlurmPhase phase = sight.job.phase;
      if (phase != SlurmPhase::waiting && phase != SlurmPhase::running) continue;
      live_batches_.insert(place.first);
      if (held.contains(place)) continue;
      bool stray = ended_.contains(place);
      if (!stray) {
        auto [batch, added] = known.try_emplace(place.first);
        if (added) batch->second = batches_.read(place.first);
        const auto index = static_cast<std::size_t>(place.second);
        // A batch without a file has come to its end, or another service is just clearing it.
        stray = !batch->second || index >= batch->second->tasks.size() ||
                !batches_.has_attempt(batch->second->tasks[index]);
      }
      if (!stray) continue;
      // Slurm takes a moment to see that a worker has ended by itself.
      const auto before = strays_.find(place);
      std::int64_t since = before == strays_.end() ? now() : before->second;
      if (now() - since >= kStrayMs) {
        ids.push_back(sight.id);
        since = now();
      }
      strays[place] = since;
    }
    strays_ = std::move(strays);
    scancel(ids);
  }

  bool is_submitting(const std::string& batch) const {
    return std::any_of(submissions_.begin(), submissions_.end(),
                       [&](const auto& s) { return s->batch == batch; });
  }

  bool is_held(const std::string& batch) const {
    return std::any_of(held_.begin(), held_.end(),
                       [&](const auto& h) { return h.second.place.first == batch; });
  }

  /// Folders of batches whose attempts have all ended, those of services that are gone included.
  void remove_ended_batches() {
    const auto is_open = [this](const std::string& token) { return batches_.has_attempt(token); };
    for (const std::string& path : ended_batch_folders(options_.store, is_open)) {
      batches_.remove(fs::path(path).filename().string());
    }
  }

  /// Done once in a while: removes batches that were not seen to end, and forgets what is
  /// remembered of batches that Slurm has forgotten.
  void sweep() {
    if (!listed_ || now() < sweep_due_) return;
    sweep_due_ = now() + kSweepIntervalMs;
    remove_ended_batches();
    std::erase_if(sizes_, [this](const auto& batch) {
      std::error_code error;
      return !live_batches_.contains(batch.first) && !is_submitting(batch.first) &&
             !fs::exists(batches_.path(batch.first), error) && !error;
    });
    live_batches_.clear();
    std::erase_if(ended_, [this](const TaskPlace& p) { return !sizes_.contains(p.first); });
  }

  // --- cancelling -------------------------------------------------------------------------------

  void force_cancelled() {
    std::vector<std::string> kill, end;
    for (auto& [token, h] : held_) {
      if (h.cancelled_ms == 0 || h.id.empty()) continue;
      const std::int64_t since = now() - h.cancelled_ms;
      if (h.signalled && !h.forced && since >= kForceMs) {
        h.forced = true;
        kill.push_back(h.id);
      }
      // The signal has not helped, whatever process got it.
      if (h.signalled && since >= 2 * kForceMs) {
        h.signalled = false;
        end.push_back(h.id);
      }
    }
    scancel(kill, "KILL");
    scancel(end);
  }

  /// Without filters like --name and --state: with them, Slurm 22.05 cancels all waiting tasks of
  /// an array when one of them is named.
  void scancel(const std::vector<std::string>& ids, const std::string& signal = {}) {
    constexpr std::size_t at_a_time = 200;
    for (std::size_t at = 0; at < ids.size(); at += at_a_time) {
      std::vector<std::string> arguments = {"scancel", "--quiet"};
      if (!signal.empty()) {
        arguments.push_back("--signal=" + signal);
        // A job that is sent SIGKILL as a whole is cancelled instead: SIGTERM first, and SIGKILL
        // after KillWait, 5 s at least. Its batch process is sent it at once, and is the worker.
        arguments.emplace_back(signal == "KILL" ? "--batch" : "--full");
      }
      const std::size_t end = std::min(ids.size(), at + at_a_time);
      arguments.insert(arguments.end(), ids.begin() + static_cast<long>(at),
                       ids.begin() + static_cast<long>(end));
      orders_.push_back(std::make_unique<Command>(arguments, kCommandLimit));
    }
  }

  SlurmEngineOptions options_;
  BatchFolder batches_;
  Patience patience_;
  std::map<std::string, HeldTask> held_;
  std::map<std::string, int> sizes_;  ///< number of tasks by batch
  std::set<TaskPlace> ended_;         ///< what we have reported as ended
  std::set<std::string> live_batches_;
  std::set<std::string> ending_batches_;      ///< tasks of them have ended, their folders are there
  std::map<TaskPlace, std::int64_t> strays_;  ///< since when, or when last cancelled
  std::vector<TaskReport> failed_;

  std::list<std::unique_ptr<Submission>> submissions_;
  std::list<std::unique_ptr<Command>> orders_;
  std::unique_ptr<Command> listing_, node_listing_;
  std::int64_t listing_begun_ = 0, listing_due_ = 0, idle_listing_due_ = 0, nodes_due_ = 0,
               sweep_due_ = 0, refused_until_ = 0;
  bool answers_ = true, listed_ = false;
  std::string complaint_;  ///< why it does not answer

  Cluster cluster_;
  int array_limit_ = 1;
};

}  // namespace

std::unique_ptr<Engine> make_slurm_engine(const SlurmEngineOptions& options) {
  return std::make_unique<SlurmEngine>(options);
}

}  // namespace slicecorr::farm
