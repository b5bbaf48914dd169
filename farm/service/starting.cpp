// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// From the queue to the engine: claims, what is in the way of a job, orders.

#include <fmt/format.h>

#include <algorithm>
#include <cerrno>
#include <filesystem>
#include <system_error>

#include "service/service_loop.hpp"
#include "slicecorr/farm/store.hpp"
#include "support/text/display_text.hpp"
#include "work/stages.hpp"

namespace slicecorr::farm::detail {

namespace fs = std::filesystem;

namespace {

/// A job that needs more memory than is free waits so long for others to end before it stops them
/// from overtaking it.
constexpr std::int64_t kOvertakingMs = 120'000;
/// Cache hits and followers are served for so long at a time, so that nothing else has to wait.
constexpr std::int64_t kServingMs = 300;

/// Room comes back by itself, and is waited for. That no more files may be open is a limit of this service: after some
/// attempts the job fails, and says so.
Reason why_not_ordered(const std::string& message) {
  for (const int error : {EMFILE, ENFILE}) {
    if (message.find(std::generic_category().message(error)) != std::string::npos) {
      return Reason::device_failed;
    }
  }
  return Reason::disk_full;
}

}  // namespace

std::string too_little_room(const std::string& path, std::int64_t free_bytes,
                            std::int64_t wanted_bytes) {
  const auto [free, wanted] =
      text::bytes_apart(static_cast<double>(free_bytes), static_cast<double>(wanted_bytes));
  return fmt::format("{}: {} free, {} are wanted", path, free, wanted);
}

bool ServiceLoop::start_jobs() {
  // Without a change of the record there is no new work: looks at most twice a second then.
  if (!changed_ && !due(retry_at_, 500)) return false;
  bool any = false;
  const std::int64_t begin = clock_.steady_ms();
  for (;;) {
    EngineCapacity capacity = engine_.capacity();
    std::vector<Task> tasks;
    while (!stop_ && static_cast<int>(tasks.size()) < capacity.tasks &&
           clock_.steady_ms() - begin < kServingMs) {
      if (!take(capacity)) break;
      any = true;
      const Claim claim = taken_.back();
      if (!has_disk(claim)) {
        // it was put back into the queue
      } else if (claim.cached) {
        deliver_cached(claim);
      } else if (const auto task = order(claim, capacity)) {
        capacity.memory_mb -= task->memory_mb;
        capacity.cores -= task->threads;
        tasks.push_back(*task);
        continue;  // the claim stays in `taken_` until the engine has the task
      }
      leases_->remove(claim.token);
      std::erase_if(taken_, [&](const Claim& c) { return c.token == claim.token; });
    }
    if (tasks.empty()) break;
    hand_over(tasks);
  }
  changed_ = any;
  return any;
}

bool ServiceLoop::take(const EngineCapacity& capacity) {
  ClaimRequest request;
  request.service = id_;
  request.engine = engine_.name();
  request.free_memory_mb = capacity.memory_mb;
  request.largest_memory_mb = capacity.largest_memory_mb;
  request.full_folders.assign(full_folders_.begin(), full_folders_.end());
  // While a job has waited too long for memory, no other may overtake it, unless nothing runs: then
  // no memory will come free by waiting.
  request.may_overtake = waiting_since_ms_ == 0 ||
                         clock_.steady_ms() - waiting_since_ms_ < kOvertakingMs || running_.empty();
  const auto claim = queue_.claim(request);
  if (claim) {
    waiting_since_ms_ = 0;
  } else if (waiting_since_ms_ == 0) {
    waiting_since_ms_ = clock_.steady_ms();
  }
  if (!claim) return false;
  taken_.push_back(*claim);
  leases_->add(claim->token);
  tell_service_stage("claimed");
  return true;
}

bool ServiceLoop::has_disk(const Claim& claim) {
  const std::string& out = claim.job.output_folder;
  const std::int64_t free = free_bytes(out);
  const std::int64_t wanted = (settings_.min_free_mb << 20) + claim.job.expected_bytes;
  const std::int64_t store = free_bytes(folder_.store);
  if (free >= wanted && store >= wanted) return true;
  full_folders_.insert(out);
  settle(running_of(claim),
         give_up_attempt(
             folder_, queue_, claim.job, attempt_of(claim),
             without_result(Reason::disk_full,
                            free < wanted ? too_little_room(out, free, wanted)
                                          : too_little_room(folder_.store, store, wanted))));
  return false;
}

std::optional<Task> ServiceLoop::order(const Claim& claim, const EngineCapacity& capacity) {
  const int doublings = std::min(claim.memory_failures, 20);
  const std::int64_t base = claim.base_memory_mb << doublings;
  const std::int64_t each = claim.thread_memory_mb << doublings;
  const auto refuse = [&](Reason reason, const std::string& message) {
    settle(running_of(claim), give_up_attempt(folder_, queue_, claim.job, attempt_of(claim),
                                              without_result(reason, message)));
    return std::nullopt;
  };
  // A job that ran out of memory gets more of it, and only one thread, so that it needs less.
  const std::int64_t waiting = claim.memory_failures > 0 ? 1 << 20 : queue_.claimable() + 1;
  Engine::TaskSize share = engine_.share(capacity, waiting, base, each);
  if (claim.memory_failures > 0) {
    share.threads = 1;
    share.memory_mb = std::max(base, claim.last_memory_mb * 2);
    if (share.memory_mb > capacity.largest_memory_mb &&
        claim.last_memory_mb < capacity.largest_memory_mb) {
      share.memory_mb = capacity.largest_memory_mb;
    }
  }
  if (share.memory_mb > capacity.largest_memory_mb) {
    return refuse(Reason::too_large,
                  fmt::format("needs {} MB of memory; a worker gets {} MB at most", share.memory_mb,
                              capacity.largest_memory_mb));
  }
  const std::string attempt_folder = folder_.attempt(claim.token);
  try {
    WorkOrder o;
    o.token = claim.token;
    o.job = claim.job.id;
    o.number = claim.number;
    o.key = claim.job.key;
    o.name = claim.job.name;
    o.spec = parse_spec(claim.spec_json);
    o.setup_json = claim.setup_json;
    o.store = folder_.store;
    o.threads = share.threads;
    o.memory_mb = share.memory_mb;
    fs::create_directories(attempt_folder);
    write_order(attempt_folder, o);
  } catch (const fs::filesystem_error& e) {
    return refuse(why_not_ordered(e.what()), e.what());
  } catch (const DeviceError& e) {
    return refuse(why_not_ordered(e.what()), e.what());
  }
  tell_service_stage("ordered");
  Task task;
  task.token = claim.token;
  task.job = claim.job.id;
  task.name = claim.job.name;
  task.folder = attempt_folder;
  task.threads = share.threads;
  task.memory_mb = share.memory_mb;
  task.priority = claim.job.priority;
  task.ready_by_ms = claim.job.ready_by_ms;
  task.expected_s = claim.job.expected_s;
  task.labels = claim.job.labels;
  return task;
}

void ServiceLoop::hand_over(const std::vector<Task>& tasks) {
  const std::vector<std::string> ids = engine_.submit(tasks);
  tell_service_stage("started");
  for (std::size_t i = 0; i < tasks.size(); ++i) {
    const Task& t = tasks[i];
    const auto claim = std::find_if(taken_.begin(), taken_.end(),
                                    [&](const Claim& c) { return c.token == t.token; });
    Running r = running_of(*claim);
    r.attempt.engine_id = ids[i];
    r.attempt.threads = t.threads;
    r.attempt.memory_mb = t.memory_mb;
    running_.emplace(t.token, std::move(r));
    taken_.erase(claim);
  }
  for (std::size_t i = 0; i < tasks.size(); ++i) {
    const Task& t = tasks[i];
    queue_.record_start(t.token, ids[i], t.threads, t.memory_mb);
    say(fmt::format("job {} {}: started, attempt {}, {} {}, {} MB", t.job, t.name,
                    running_.at(t.token).attempt.number, t.threads,
                    t.threads == 1 ? "thread" : "threads", t.memory_mb));
  }
}

void ServiceLoop::deliver_cached(const Claim& claim) {
  if (!finish_from_cache(folder_, queue_, claim)) return;
  ++totals_.done;
  ++totals_.from_cache;
  say(fmt::format("job {} {}: done, from the cache", claim.job.id, claim.job.name));
}

void ServiceLoop::put_back_taken() {
  while (!taken_.empty()) {
    const Claim& claim = taken_.back();
    settle(running_of(claim),
           give_up_attempt(folder_, queue_, claim.job, attempt_of(claim),
                           without_result(Reason::stopped, "could not be started")));
    leases_->remove(claim.token);
    taken_.pop_back();
  }
}

Running ServiceLoop::running_of(const Claim& claim) {
  Running r;
  r.job = claim.job;
  r.attempt = attempt_of(claim);
  r.beat_steady_ms = clock_.steady_ms();
  return r;
}

Attempt ServiceLoop::attempt_of(const Claim& claim) {
  Attempt a;
  a.token = claim.token;
  a.job = claim.job.id;
  a.number = claim.number;
  a.engine = engine_.name();
  return a;
}

}  // namespace slicecorr::farm::detail
