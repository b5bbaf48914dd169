#include "slicecorr/farm/service.hpp"

#include <fmt/format.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include <algorithm>
#include <csignal>
#include <filesystem>
#include <map>
#include <optional>
#include <set>
#include <utility>

#include "service/commit.hpp"
#include "service/leases.hpp"
#include "slicecorr/farm/store.hpp"

namespace slicecorr::farm {

namespace fs = std::filesystem;
using detail::Settled;

namespace {

/// How long the service sleeps at most: a cancellation or a setting is seen within this time.
constexpr auto longest_wait = std::chrono::milliseconds(200);
constexpr std::int64_t progress_interval_ms = 1000;
constexpr std::int64_t orphan_interval_ms = 5000;
constexpr std::int64_t disk_interval_ms = 2000;
constexpr std::int64_t gc_interval_ms = 600'000;
/// A job that needs more memory than is free waits so long for others to end before it stops them
/// from overtaking it.
constexpr std::int64_t overtaking_ms = 120'000;
/// Cache hits and followers are served for so long at a time, so that nothing else has to wait.
constexpr std::int64_t serving_ms = 300;
constexpr std::int64_t followers_at_once = 10;
/// Disks and databases may fail for so long before the service gives up.
constexpr std::int64_t longest_trouble_ms = 600'000;
/// Workers that are asked to end with the service get this long.
constexpr std::int64_t stop_patience_ms = 3000;

/// An attempt that the engine has.
struct Running {
  Job job;
  Attempt attempt;
  bool started = false;  ///< the engine says that it runs
  std::int64_t beat = -1, beat_steady_ms = 0;
  bool hung = false, cancelled = false, lost = false;
  std::optional<TaskReport> end;  ///< when it has ended
};

class ServiceLoop {
 public:
  ServiceLoop(const FarmFolder& folder, Engine& engine, const ServiceOptions& options,
              const std::atomic<bool>& stop)
      : folder_(folder),
        engine_(engine),
        options_(options),
        stop_(stop),
        clock_(*options.clock),
        queue_(folder.database(), clock_),
        settings_(queue_.settings()),
        wake_fd_(::eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK)) {
    int cores = 0;
    std::int64_t memory_mb = 0;
    for (const Node& n : engine_.nodes()) {
      if (!n.usable) continue;
      cores += n.cores;
      memory_mb += n.memory_mb;
    }
    id_ = queue_.start_service(engine_.name(), cores, memory_mb);
    leases_ = std::make_unique<detail::LeaseKeeper>(folder.database(), clock_, id_,
                                                    options.renewal_ms, wake_fd_);
  }
  ~ServiceLoop() {
    leases_.reset();
    if (wake_fd_ >= 0) ::close(wake_fd_);
  }

  ServiceTotals run() {
    while (!stop_) {
      bool started = false;
      try {
        if (!round(started)) break;
        trouble_since_ms_ = 0;
      } catch (const DeviceError& e) {
        endure(e);
      }
      if (!started) engine_.wait(longest_wait, wake_fd_);
      drain_wake();
    }
    stop_running();
    leases_.reset();
    queue_.stop_service(id_);
    return totals_;
  }

 private:
  /// One look at everything. False: there is nothing more to do.
  bool round(bool& started) {
    read_settings();
    put_back_taken();
    end_lost();
    end_cancelled();
    settle_ended();
    note_progress();
    if (due(orphans_at_, orphan_interval_ms)) recover();
    settle_adopted();
    const std::string doing = why_idle();
    const std::string trouble = doing.empty() ? engine_.trouble() : "";
    leases_->set_doing(!doing.empty() ? doing : trouble.empty() ? "working" : trouble);
    tell_change(doing);
    tell_trouble(trouble);
    if (!doing.empty()) engine_.withdraw();
    started = doing.empty() && start_jobs();
    if (settings_.draining && running_.empty()) {
      say("drained");
      return false;
    }
    if (options_.until_empty && running_.empty() && !started && queue_.unfinished() == 0) {
      return false;
    }
    collect();
    return true;
  }

  /// A full disk or a locked database must not end the night: what was begun is kept in mind and
  /// tried again. After too long it is no passing trouble.
  void endure(const DeviceError& e) {
    const std::int64_t now = clock_.steady_ms();
    if (trouble_since_ms_ == 0) {
      trouble_since_ms_ = now;
      say(fmt::format("{}; trying on", e.what()));
    } else if (now - trouble_since_ms_ > longest_trouble_ms) {
      throw e;
    }
    engine_.wait(std::chrono::seconds(1), -1);
  }

  void say(const std::string& text) {
    if (options_.say) options_.say(text);
  }

  /// True once per interval of steady time.
  bool due(std::int64_t& at, std::int64_t interval_ms) {
    const std::int64_t now = clock_.steady_ms();
    if (at != 0 && now - at < interval_ms) return false;
    at = now;
    return true;
  }

  void drain_wake() {
    std::uint64_t count = 0;
    [[maybe_unused]] const ssize_t n = ::read(wake_fd_, &count, sizeof count);
  }

  void read_settings() {
    const std::int64_t version = queue_.data_version();
    if (version == data_version_) return;
    data_version_ = version;
    settings_ = queue_.settings();
    cancellations_ = queue_.cancellations(id_);
    changed_ = true;
  }

  /// Why nothing may start now; empty: it may.
  std::string why_idle() {
    if (settings_.draining) return "draining";
    if (settings_.paused) return "paused";
    if (!in_night_window(settings_, local_minute(clock_.wall_ms()))) {
      return "outside the night window";
    }
    if (due(disk_at_, disk_interval_ms)) {
      full_folders_.clear();
      const std::int64_t limit = settings_.min_free_mb << 20;
      std::string low;
      for (const std::string& path : {folder_.store, folder_.root}) {
        const std::int64_t free = free_bytes(path);
        if (free < limit) low = fmt::format("{}: {} MB free", path, free >> 20);
      }
      if (!low.empty() && disk_low_.empty()) queue_.add_event("disk_low", low);
      if (low.empty() && !disk_low_.empty()) queue_.add_event("disk_ok", "");
      disk_low_ = low;
    }
    return disk_low_.empty() ? "" : "disk full: " + disk_low_;
  }

  void tell_change(const std::string& doing) {
    if (doing == told_) return;
    const std::string night = "outside the night window";
    if (doing == night) queue_.add_event("night_ended", "");
    if (told_ == night && doing.empty()) queue_.add_event("night_began", "");
    say(doing.empty() ? "working" : doing);
    told_ = doing;
  }

  /// The engine's: nothing is taken back for it, it may be over any moment.
  void tell_trouble(const std::string& trouble) {
    if (trouble == told_trouble_) return;
    say(trouble.empty() ? engine_.name() + " works again" : trouble);
    told_trouble_ = trouble;
  }

  // --- starting ---------------------------------------------------------------------------------

  /// True when a job was started or finished: there may be more to do at once.
  bool start_jobs() {
    // Looking for work takes no writing; but without a change there is none.
    if (!changed_ && !due(retry_at_, 500)) return false;
    bool any = false;
    const std::int64_t begin = clock_.steady_ms();
    for (;;) {
      Room room = engine_.room();
      std::vector<Task> tasks;
      while (!stop_ && static_cast<int>(tasks.size()) < room.tasks &&
             clock_.steady_ms() - begin < serving_ms) {
        if (!take(room)) break;
        any = true;
        const Claim claim = taken_.back();
        if (!has_disk(claim)) {
          // put back
        } else if (claim.cached) {
          deliver_cached(claim);
        } else if (const auto task = order(claim, room)) {
          room.memory_mb -= task->memory_mb;
          room.cores -= task->threads;
          tasks.push_back(*task);
          continue;  // stays taken until the engine has it
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

  void deliver_cached(const Claim& claim) {
    if (!finish_from_cache(folder_, queue_, claim)) return;
    ++totals_.done;
    ++totals_.from_cache;
    say(fmt::format("job {} {}: done, from the cache", claim.job.id, claim.job.name));
  }

  /// Jobs that were claimed when something failed, and were not started.
  void put_back_taken() {
    while (!taken_.empty()) {
      const Claim& claim = taken_.back();
      settle(running_of(claim),
             detail::give_up_attempt(folder_, queue_, claim.job, attempt_of(claim),
                                     without_result(Reason::stopped, "could not be started")));
      leases_->remove(claim.token);
      taken_.pop_back();
    }
  }

  /// Claims a job into `taken_`.
  bool take(const Room& room) {
    ClaimRequest request;
    request.service = id_;
    request.engine = engine_.name();
    request.free_memory_mb = room.memory_mb;
    request.largest_memory_mb = room.largest_memory_mb;
    request.full_folders.assign(full_folders_.begin(), full_folders_.end());
    // While somebody waits too long for memory, nobody overtakes; with nothing running there is
    // nothing to wait for.
    request.may_overtake = waiting_since_ms_ == 0 ||
                           clock_.steady_ms() - waiting_since_ms_ < overtaking_ms ||
                           running_.empty();
    const auto claim = queue_.claim(request);
    if (claim) {
      waiting_since_ms_ = 0;
    } else if (waiting_since_ms_ == 0) {
      waiting_since_ms_ = clock_.steady_ms();
    }
    if (!claim) return false;
    taken_.push_back(*claim);
    leases_->add(claim->token);
    detail::service_fault("claimed");
    return true;
  }

  AttemptEnd without_result(Reason reason, const std::string& message) {
    AttemptEnd end;
    end.reason = reason;
    end.message = message;
    return end;
  }

  Running running_of(const Claim& claim) {
    Running r;
    r.job = claim.job;
    r.attempt = attempt_of(claim);
    r.beat_steady_ms = clock_.steady_ms();
    return r;
  }

  Attempt attempt_of(const Claim& claim) {
    Attempt a;
    a.token = claim.token;
    a.job = claim.job.id;
    a.number = claim.number;
    a.engine = engine_.name();
    return a;
  }

  bool has_disk(const Claim& claim) {
    const std::string& out = claim.job.output_folder;
    const std::int64_t free = free_bytes(out);
    const std::int64_t wanted = (settings_.min_free_mb << 20) + claim.job.expected_bytes;
    const std::int64_t store = free_bytes(folder_.store);
    if (free >= wanted && store >= wanted) return true;
    full_folders_.insert(out);
    settle(running_of(claim),
           detail::give_up_attempt(
               folder_, queue_, claim.job, attempt_of(claim),
               without_result(Reason::disk_full,
                              fmt::format("{}: {} MB free, {} MB are wanted",
                                          free < wanted ? out : folder_.store,
                                          std::min(free, store) >> 20, wanted >> 20))));
    return false;
  }

  /// Writes the order; none when the job can't be done here.
  std::optional<Task> order(const Claim& claim, const Room& room) {
    const int doublings = std::min(claim.memory_failures, 20);
    const std::int64_t base = claim.base_memory_mb << doublings;
    const std::int64_t each = claim.thread_memory_mb << doublings;
    const auto refuse = [&](Reason reason, const std::string& message) {
      settle(running_of(claim),
             detail::give_up_attempt(folder_, queue_, claim.job, attempt_of(claim),
                                     without_result(reason, message)));
      return std::nullopt;
    };
    // One that ran out of memory gets more of it, and needs less with one thread.
    const std::int64_t waiting = claim.memory_failures > 0 ? 1 << 20 : queue_.claimable() + 1;
    Engine::Share share = engine_.share(room, waiting, base, each);
    if (claim.memory_failures > 0) {
      share.threads = 1;
      share.memory_mb = std::max(base, claim.last_memory_mb * 2);
      if (share.memory_mb > room.largest_memory_mb &&
          claim.last_memory_mb < room.largest_memory_mb) {
        share.memory_mb = room.largest_memory_mb;
      }
    }
    if (share.memory_mb > room.largest_memory_mb) {
      return refuse(Reason::too_large,
                    fmt::format("needs {} MB of memory; a worker gets {} MB at most",
                                share.memory_mb, room.largest_memory_mb));
    }
    const std::string attempt_folder = folder_.attempt(claim.token);
    try {
      Order o;
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
      return refuse(Reason::disk_full, e.what());
    } catch (const DeviceError& e) {
      return refuse(Reason::disk_full, e.what());
    }
    detail::service_fault("ordered");
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

  void hand_over(const std::vector<Task>& tasks) {
    const std::vector<std::string> ids = engine_.submit(tasks);
    detail::service_fault("started");
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

  // --- watching ---------------------------------------------------------------------------------

  void end_lost() {
    for (const std::string& token : leases_->take_lost()) {
      const auto found = running_.find(token);
      if (found == running_.end()) continue;
      if (engine_.outlives_service()) {
        // Either somebody else looks after the same work now, or it was given up: then the engine
        // finds it as a stray.
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

  void end_cancelled() {
    for (const std::string& token : std::exchange(cancellations_, {})) {
      const auto found = running_.find(token);
      if (found == running_.end() || found->second.cancelled) continue;
      found->second.cancelled = true;
      engine_.cancel({token});
    }
  }

  void note_progress() {
    if (!due(progress_at_, progress_interval_ms)) return;
    std::vector<Queue::Progress> list;
    const std::int64_t now = clock_.steady_ms();
    for (auto& [token, r] : running_) {
      const auto note = read_progress(folder_.attempt(token));
      if (note && note->beat != r.beat) {
        r.beat = note->beat;
        r.beat_steady_ms = now;
        list.push_back({token, note->stage, note->node, note->fraction, note->layers_done});
      }
      if (!note && !r.started) r.beat_steady_ms = now;  // it waits in the engine
      if (!r.hung && static_cast<double>(now - r.beat_steady_ms) > settings_.hang_s * 1000) {
        r.hung = true;
        say(fmt::format("job {} {}: no progress for {:g} s; its worker is ended", r.job.id,
                        r.job.name, settings_.hang_s));
        engine_.cancel({token});
      }
    }
    queue_.record_progress(list);
  }

  void settle_ended() {
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
      detail::service_fault("ended");
      // Forgotten only when it is settled: this may throw, and is tried again then.
      settle(it->second, end_of(it->second, *it->second.end));
      leases_->remove(it->first);
      it = running_.erase(it);
      changed_ = true;
    }
  }

  Settled end_of(const Running& r, const TaskReport& report) {
    const auto outcome = read_outcome(folder_.attempt(r.attempt.token));
    const bool whole = outcome && outcome->token == r.attempt.token;
    if (whole && outcome->reason == Reason::none && !r.lost) {
      return detail::commit_result(folder_, queue_, r.job, r.attempt, *outcome);
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
      // Somebody else asked it to stop.
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
      // It had no room for its result, or not even for its log.
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
      end.message = fmt::format("no progress for {:g} s", settings_.hang_s);
    } else if (stopping_ && !r.cancelled) {
      end.reason = Reason::stopped;
      end.message = "the service was stopped";
    }
    if (r.cancelled) end.message = "cancelled while it ran";
    return detail::give_up_attempt(folder_, queue_, r.job, r.attempt, end);
  }

  void settle(const Running& r, Settled settled) {
    const auto tell = [&](const char* what) {
      say(fmt::format("job {} {}: {}", r.job.id, r.job.name, what));
    };
    switch (settled) {
      case Settled::done:
        ++totals_.done;
        tell("done");
        break;
      case Settled::put_back:
        ++totals_.put_back;
        tell("put back");
        break;
      case Settled::failed:
        ++totals_.failed;
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
      const std::int64_t more =
          serve_from_cache(folder_, queue_, id_, r.job.key, followers_at_once);
      totals_.done += more;
      totals_.from_cache += more;
      if (more > 0) say(fmt::format("{} more with the same work: done, from the cache", more));
    }
  }

  // --- beginning and end ------------------------------------------------------------------------

  /// Takes over what services that are gone left behind.
  void recover() {
    if (!std::exchange(swept_, true)) {
      // Of services that were killed between their last change of the record and tidying up.
      for (const std::string& path : detail::ended_attempt_folders(folder_, queue_)) {
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

  void settle_adopted() {
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
        settle(r, detail::commit_result(folder_, queue_, o.job, o.attempt, *outcome));
      } else {
        settle(r, detail::give_up_attempt(
                      folder_, queue_, o.job, o.attempt,
                      without_result(Reason::lease_lost, "its service ended before it did")));
      }
      leases_->remove(o.attempt.token);
      adopted_.pop_back();
    }
    changed_ = true;
  }

  void collect() {
    if (settings_.cache_max_mb <= 0 || !due(gc_at_, gc_interval_ms)) return;
    GcOptions o;
    o.max_mb = settings_.cache_max_mb;
    collect_garbage(folder_, queue_, o);
  }

  void stop_running() {
    if (running_.empty() || engine_.outlives_service()) return;
    stopping_ = true;
    std::vector<std::string> tokens;
    for (const auto& [token, r] : running_) tokens.push_back(token);
    engine_.cancel(tokens);
    const std::int64_t until = clock_.steady_ms() + stop_patience_ms;
    while (!running_.empty() && clock_.steady_ms() < until) {
      engine_.wait(std::chrono::milliseconds(50), -1);
      settle_ended();
    }
    // Whoever is still there dies with us; the jobs go back all the same.
    for (const auto& [token, r] : running_) {
      detail::give_up_attempt(folder_, queue_, r.job, r.attempt,
                              without_result(Reason::stopped, "the service was stopped"));
    }
    running_.clear();
  }

  const FarmFolder& folder_;
  Engine& engine_;
  const ServiceOptions& options_;
  const std::atomic<bool>& stop_;
  const Clock& clock_;
  Queue queue_;
  Settings settings_;
  int wake_fd_;
  std::string id_;
  std::unique_ptr<detail::LeaseKeeper> leases_;
  std::map<std::string, Running> running_;  ///< by token
  std::vector<Claim> taken_;                ///< claimed, not yet the engine's
  std::vector<OwnedAttempt> adopted_;       ///< of services that are gone, not yet settled
  std::vector<std::string> cancellations_;
  std::set<std::string> full_folders_;
  std::string disk_low_, told_ = "-", told_trouble_;
  bool changed_ = true, stopping_ = false, swept_ = false;
  std::int64_t data_version_ = -1, progress_at_ = 0, orphans_at_ = 0, disk_at_ = 0, gc_at_ = 0,
               retry_at_ = 0, waiting_since_ms_ = 0, trouble_since_ms_ = 0;
  ServiceTotals totals_;
};

}  // namespace

ServiceTotals run_service(const FarmFolder& folder, Engine& engine, const ServiceOptions& options,
                          const std::atomic<bool>& stop) {
  return ServiceLoop(folder, engine, options, stop).run();
}

}  // namespace slicecorr::farm
