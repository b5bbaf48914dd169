// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// From the engine to the record: progress, ends of all kinds, and what other services left.

#include <fmt/format.h>

#include <algorithm>
#include <csignal>
#include <filesystem>
#include <utility>

#include "service/service_loop.hpp"
#include "slicecorr/farm/store.hpp"
#include "slicecorr/farm/work.hpp"
#include "work/stages.hpp"

namespace slicecorr::farm::detail {

namespace fs = std::filesystem;

namespace {

constexpr std::int64_t kProgressIntervalMs = 1000;
constexpr std::int64_t kFollowersAtOnce = 10;
/// Workers that are asked to end with the service get this long.
constexpr std::int64_t kStopPatienceMs = 3000;

}  // namespace

void ServiceLoop::end_lost() {
  for (const std::string& token : leases_->take_lost()) {
    const auto found = running_.find(token);
    if (found == running_.end()) continue;
    if (engine_.outlives_service()) {
      // Either another service looks after the attempt now, or it was given up: then the engine
      // finds its task as a stray.
      say(fmt::format("job {} {}: lease lost; left to whoever has it", found->second.job.id,
                      found->second.job.name));
      engine_.forget({token});
      running_.erase(found);
      continue;
    }
    found->second.lost = true;
    say(fmt::format("job {} {}: lease lost; its worker is ended", found->second.job.id,
                    found->second.job.name));
    engine_.cancel({token});
  }
}

void ServiceLoop::end_cancelled() {
  for (const std::string& token : std::exchange(cancellations_, {})) {
    const auto found = running_.find(token);
    if (found == running_.end() || found->second.cancelled) continue;
    found->second.cancelled = true;
    engine_.cancel({token});
  }
}

void ServiceLoop::note_progress() {
  if (!due(progress_at_, kProgressIntervalMs)) return;
  std::vector<Queue::Progress> list;
  const std::int64_t now = clock_.steady_ms();
  for (auto& [token, r] : running_) {
    const auto note = read_progress(folder_.attempt(token));
    if (note && note->beat != r.beat) {
      r.beat = note->beat;
      r.beat_steady_ms = now;
      list.push_back({token, note->stage, note->node, note->fraction, note->layers_done});
    }
    if (!note && !r.started) r.beat_steady_ms = now;  // waits in the engine: does not hang
    if (!r.hung && static_cast<double>(now - r.beat_steady_ms) > settings_.hang_s * 1000) {
      r.hung = true;
      say(fmt::format("job {} {}: no progress for {} s; its worker is ended", r.job.id, r.job.name,
                      settings_.hang_s));
      engine_.cancel({token});
    }
  }
  queue_.record_progress(list);
}

void ServiceLoop::settle_ended() {
  for (const TaskReport& report : engine_.poll()) {
    const auto found = running_.find(report.token);
    if (found == running_.end()) continue;
    if (report.state == TaskState::running) found->second.started = true;
    if (report.state == TaskState::ended) found->second.end = report;
  }
  for (auto it = running_.begin(); it != running_.end();) {
    if (!it->second.end) {
      ++it;
      continue;
    }
    tell_service_stage("ended");
    // Removed from `running_` only after this, which may throw and is then tried again.
    settle(it->second, end_of(it->second, *it->second.end));
    leases_->remove(it->first);
    it = running_.erase(it);
    changed_ = true;
  }
  engine_.tidy(false);
}

Settled ServiceLoop::end_of(const Running& r, const TaskReport& report) {
  const auto outcome = read_outcome(folder_.attempt(r.attempt.token));
  const bool whole = outcome && outcome->token == r.attempt.token;
  if (whole && outcome->reason == Reason::none && !r.lost) {
    return commit_result(folder_, queue_, r.job, r.attempt, *outcome);
  }
  AttemptEnd end;
  end.node = report.node;
  end.cpu_s = report.cpu_s;
  end.peak_mb = report.peak_mb;
  end.wall_s = static_cast<double>(clock_.wall_ms() - r.job.started_ms) / 1000;
  end.exit_code = report.exit_code;
  if (whole) {
    end.node = outcome->node;
    end.cpu_s = outcome->cpu_s;
    end.peak_mb = outcome->peak_mb;
    end.wall_s = outcome->wall_s;
    end.exit_code = outcome->exit_code;
    end.reason = outcome->reason;
    end.message = outcome->message;
    // Stopped, though not by this service: somebody else asked the worker to stop.
    if (end.reason == Reason::stopped && !stopping_) {
      end.reason = report.reason != Reason::none ? report.reason : Reason::worker_killed;
      if (!report.message.empty()) end.message = report.message;
    }
  } else if (report.reason != Reason::none) {
    end.reason = report.reason;
    end.message = report.message;
  } else if (report.signal != 0) {
    const bool ended_from_outside = report.signal == SIGKILL || report.signal == SIGTERM ||
                                    report.signal == SIGINT || report.signal == SIGHUP;
    end.reason = ended_from_outside ? Reason::worker_killed : Reason::worker_crashed;
    end.message = fmt::format("the worker was ended by signal {}", report.signal);
  } else if (report.exit_code == 4) {
    // The worker had no room for its result, or not even for its log.
    end.reason = Reason::disk_full;
    end.message = "the worker could not write its result";
  } else {
    end.reason = Reason::worker_crashed;
    end.message =
        fmt::format("the worker ended with exit code {} and without a result", report.exit_code);
  }
  if (r.lost) {
    end.reason = Reason::lease_lost;
    end.message = "the lease was lost";
  } else if (r.hung) {
    end.reason = Reason::hung;
    end.message = fmt::format("no progress for {} s", settings_.hang_s);
  } else if (stopping_ && !r.cancelled) {
    end.reason = Reason::stopped;
    end.message = "the service was stopped";
  }
  if (r.cancelled) end.message = "cancelled while it ran";
  return give_up_attempt(folder_, queue_, r.job, r.attempt, end);
}

void ServiceLoop::settle(const Running& r, Settled settled) {
  const auto tell = [&](const char* what) {
    say(fmt::format("job {} {}: {}", r.job.id, r.job.name, what));
  };
  switch (settled) {
    case Settled::done:
      ++totals_.done;
      say(fmt::format("job {} {}: done, in {}", r.job.id, r.job.name, r.job.output_folder));
      break;
    case Settled::put_back:
      ++totals_.put_back;
      tell("put back");
      break;
    case Settled::failed:
      tell("failed");
      break;
    case Settled::cancelled:
      tell("cancelled");
      break;
    case Settled::lost:
      tell("was given to another attempt");
      break;
  }
  if (settled == Settled::done) {
    const std::int64_t more = serve_from_cache(folder_, queue_, id_, r.job.key, kFollowersAtOnce);
    totals_.done += more;
    totals_.from_cache += more;
    if (more > 0) say(fmt::format("{} more with the same work: done, from the cache", more));
  }
}

void ServiceLoop::recover() {
  if (!std::exchange(swept_, true)) {
    // Folders that services left which were killed between their last change of the record and
    // tidying up.
    for (const std::string& path : ended_attempt_folders(folder_, queue_)) {
      std::error_code error;
      fs::remove_all(path, error);
    }
  }
  for (const OwnedAttempt& orphan : queue_.orphans()) {
    const std::string& token = orphan.attempt.token;
    if (running_.contains(token)) continue;
    // Another engine's work may still run; its own service comes back for it, within the lease.
    const std::string& engine = orphan.attempt.engine;
    if (engine != engine_.name() && engine != "cache" && !orphan.lease_expired) continue;
    if (!queue_.adopt(token, id_)) continue;
    leases_->add(token);
    adopted_.push_back(orphan);
  }
}

void ServiceLoop::settle_adopted() {
  if (adopted_.empty()) return;
  std::vector<Attempt> of_engine;
  for (const OwnedAttempt& o : adopted_) {
    if (o.attempt.engine == engine_.name()) of_engine.push_back(o.attempt);
  }
  const std::vector<std::string> known = engine_.adopt(of_engine);
  while (!adopted_.empty()) {
    const OwnedAttempt& o = adopted_.back();
    Running r;
    r.job = o.job;
    r.attempt = o.attempt;
    r.beat_steady_ms = clock_.steady_ms();
    const auto outcome = read_outcome(folder_.attempt(o.attempt.token));
    if (std::find(known.begin(), known.end(), o.attempt.token) != known.end()) {
      say(fmt::format("job {} {}: still at work, looked after again", o.job.id, o.job.name));
      running_.emplace(o.attempt.token, std::move(r));
      adopted_.pop_back();
      continue;
    }
    if (outcome && outcome->token == o.attempt.token && outcome->reason == Reason::none) {
      say(fmt::format("job {} {}: was finished when its service ended", o.job.id, o.job.name));
      settle(r, commit_result(folder_, queue_, o.job, o.attempt, *outcome));
    } else {
      settle(r, give_up_attempt(
                    folder_, queue_, o.job, o.attempt,
                    without_result(Reason::lease_lost, "its service ended before it did")));
    }
    leases_->remove(o.attempt.token);
    adopted_.pop_back();
  }
  changed_ = true;
}

void ServiceLoop::stop_running() {
  if (running_.empty() || engine_.outlives_service()) return;
  stopping_ = true;
  std::vector<std::string> tokens;
  for (const auto& [token, r] : running_) tokens.push_back(token);
  engine_.cancel(tokens);
  const std::int64_t until = clock_.steady_ms() + kStopPatienceMs;
  while (!running_.empty() && clock_.steady_ms() < until) {
    engine_.wait(std::chrono::milliseconds(50), -1);
    settle_ended();
  }
  // Workers that are still there end with this process; their jobs go back into the queue.
  for (const auto& [token, r] : running_) {
    give_up_attempt(folder_, queue_, r.job, r.attempt,
                    without_result(Reason::stopped, "the service was stopped"));
  }
  running_.clear();
}

}  // namespace slicecorr::farm::detail
