// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// What Slurm's listings say of tasks, and cancelling.

#include <algorithm>
#include <csignal>
#include <filesystem>
#include <optional>

#include "engine/slurm_engine.hpp"
#include "slicecorr/error.hpp"

namespace slicecorr::farm::detail {

namespace fs = std::filesystem;

namespace {

/// After this, a worker that was asked to end is killed.
constexpr std::int64_t kForceMs = 1000;
/// A job in Slurm that no service waits for is cancelled after this time.
constexpr std::int64_t kStrayMs = 10'000;
constexpr std::int64_t kSweepIntervalMs = 60'000;

}  // namespace

void SlurmEngine::start_listing() {
  if (listing_ || now() < listing_due_ || (held_.empty() && now() < idle_listing_due_)) return;
  listing_begun_ = now();
  // All jobs in one question. By default squeue cuts lists of tasks at 64 characters.
  listing_ = std::make_unique<Command>(
      std::vector<std::string>{"squeue", "--json", "--states=all", "--me"}, kCommandLimit, "",
      std::vector<std::string>{"SLURM_BITSTR_LEN=0"});
}

void SlurmEngine::take_listing(std::vector<TaskReport>& reports) {
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

bool SlurmEngine::any_cancelled() const {
  return std::any_of(held_.begin(), held_.end(),
                     [](const auto& h) { return h.second.cancelled_ms != 0; });
}

WorkerTrace SlurmEngine::left_by(const HeldTask& h) const {
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

void SlurmEngine::judge_all(const Sightings* seen, std::vector<TaskReport>& reports) {
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

bool SlurmEngine::out_of_patience(const HeldTask& h) const {
  return h.cancelled_ms != 0 && now() - h.cancelled_ms >= patience_.cancel_ms;
}

void SlurmEngine::end_strays(const Sightings& seen) {
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

bool SlurmEngine::is_submitting(const std::string& batch) const {
  return std::any_of(submissions_.begin(), submissions_.end(),
                     [&](const auto& s) { return s->batch == batch; });
}

bool SlurmEngine::is_held(const std::string& batch) const {
  return std::any_of(held_.begin(), held_.end(),
                     [&](const auto& h) { return h.second.place.first == batch; });
}

void SlurmEngine::remove_ended_batches() {
  const auto is_open = [this](const std::string& token) { return batches_.has_attempt(token); };
  for (const std::string& path : ended_batch_folders(options_.store, is_open)) {
    batches_.remove(fs::path(path).filename().string());
  }
}

void SlurmEngine::sweep() {
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

void SlurmEngine::force_cancelled() {
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

void SlurmEngine::scancel(const std::vector<std::string>& ids, const std::string& signal) {
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

}  // namespace slicecorr::farm::detail
