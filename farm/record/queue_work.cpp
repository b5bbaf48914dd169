// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// What services do with the queue: claim, lease, progress, commit, give up.

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <climits>

#include "record/rows.hpp"
#include "slicecorr/farm/queue.hpp"
#include "slicecorr/farm/token.hpp"
#include "values/process_mark.hpp"

namespace slicecorr::farm {

using detail::Database;
using detail::Rows;
using detail::Transaction;

namespace {

/// A job that took its service with it so often takes the next one, too.
constexpr std::int64_t kMostLostLeases = 20;

/// Jobs passed over at most for want of memory: a claim must stay short.
constexpr int kMostOvertaken = 64;

/// Older measurements count less: by 2 % with each new one.
constexpr double kFading = 0.98;

std::string host_name() {
  char name[HOST_NAME_MAX + 1] = {};
  return ::gethostname(name, sizeof name - 1) == 0 ? name : "";
}

/// The same machine start, and the same space of process numbers.
std::string boot_text(const FarmClock& clock, const detail::ProcessMark& mark) {
  return clock.boot_id() + " " + mark.space;
}

/// Users who have as many jobs running as they may.
std::vector<std::string> users_at_limit(Database& db) {
  const FarmSettings settings = detail::read_settings(db);
  std::vector<std::string> full_users;
  Rows rows = db.query("SELECT user, sum(jobs) FROM counts WHERE state = 'running' GROUP BY user");
  while (rows.next()) {
    const int limit = running_limit(settings, rows.text(0));
    if (limit > 0 && rows.integer(1) >= limit) full_users.push_back(rows.text(0));
  }
  return full_users;
}

/// Jobs that may be claimed, the most urgent first: id, whether the result is there, memory, MB. A
/// clock that was set back must not hold a job longer than its delay can be.
Rows jobs_to_claim(Database& db, const ClaimRequest& request, std::int64_t now) {
  if (!request.cached_key.empty()) {
    return db.query(
        "SELECT j.id, 1, 0 FROM jobs j JOIN works w ON w.key = j.key "
        "JOIN results r ON r.key = j.key AND r.stored WHERE j.key = ?1 AND j.state = 'queued' "
        "AND j.follows = 0 AND (j.not_before_ms <= ?2 OR j.not_before_ms > ?2 + ?3) "
        "ORDER BY j.priority DESC, j.ready_by_ms, j.id",
        request.cached_key, now, kLongestDelayMs);
  }
  // In the order of the index, so that the first rows are all that is read of a long queue.
  return db.query(
      "SELECT j.id, EXISTS(SELECT 1 FROM results r WHERE r.key = j.key AND r.stored), "
      "CASE j.memory_failures WHEN 0 THEN w.base_memory_mb "
      "ELSE max(w.base_memory_mb << min(j.memory_failures, 20), 2 * coalesce((SELECT memory_mb "
      "FROM attempts WHERE job = j.id AND reason = 'out_of_memory' ORDER BY number DESC "
      "LIMIT 1), 0)) END FROM jobs j INDEXED BY jobs_to_claim "
      "CROSS JOIN works w ON w.key = j.key WHERE j.state = 'queued' AND j.follows = 0 "
      "AND (j.not_before_ms <= ?1 OR j.not_before_ms > ?1 + ?2) AND j.user NOT IN (SELECT value "
      "FROM json_each(?3)) AND (?4 = '[]' OR j.output_folder NOT IN (SELECT value "
      "FROM json_each(?4))) ORDER BY j.priority DESC, j.ready_by_ms, j.id",
      now, kLongestDelayMs, detail::list_json(users_at_limit(db)),
      detail::list_json(request.full_folders));
}

struct ChosenJob {
  JobId id = 0;
  bool cached = false;  ///< its result is there
};

/// The most urgent job that fits into the memory that is free; id 0: none.
ChosenJob choose_job(Database& db, const ClaimRequest& request, std::int64_t now) {
  Rows rows = jobs_to_claim(db, request, now);
  for (int passed = 0; passed < kMostOvertaken && rows.next(); ++passed) {
    const bool cached = rows.integer(1) != 0;
    std::int64_t needed_mb = rows.integer(2);
    if (request.largest_memory_mb > 0) needed_mb = std::min(needed_mb, request.largest_memory_mb);
    if (cached || needed_mb <= request.free_memory_mb) return {rows.integer(0), cached};
    if (!request.may_overtake) break;
  }
  return {};
}

/// What is to be done, and the memory that it takes.
void read_work(Database& db, JobId id, Claim& claim) {
  Rows rows = db.query(
      "SELECT w.spec, s.json, w.base_memory_mb, w.thread_memory_mb, j.memory_failures, "
      "coalesce((SELECT memory_mb FROM attempts WHERE job = j.id AND reason = 'out_of_memory' "
      "ORDER BY number DESC LIMIT 1), 0) FROM jobs j JOIN works w ON w.key = j.key "
      "JOIN setups s ON s.hash = w.setup WHERE j.id = ?1",
      id);
  rows.next();
  claim.spec_json = rows.text(0);
  claim.setup_json = rows.text(1);
  claim.base_memory_mb = rows.integer(2);
  claim.thread_memory_mb = rows.integer(3);
  claim.memory_failures = static_cast<int>(rows.integer(4));
  claim.last_memory_mb = rows.integer(5);
}

}  // namespace

std::string Queue::start_service(const std::string& engine, int cores, std::int64_t memory_mb) {
  std::string id = random_token();
  const detail::ProcessMark mark = detail::mark_of(::getpid());
  Transaction transaction(*db_);
  const std::int64_t now = clock_->wall_ms();
  db_->run(
      "INSERT INTO services(id, engine, host, pid, process_start, boot, cores, memory_mb, "
      "started_ms, seen_ms) VALUES(?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8, ?9, ?9)",
      id, engine, host_name(), std::int64_t{mark.pid}, mark.start, boot_text(*clock_, mark), cores,
      memory_mb, now);
  event("service_started", fmt::format("engine {}, process {}", engine, mark.pid));
  transaction.commit();
  return id;
}

void Queue::stop_service(const std::string& service) {
  Transaction transaction(*db_);
  if (db_->run("UPDATE services SET stopped_ms = ?2, doing = '' WHERE id = ?1 AND stopped_ms = 0",
               service, clock_->wall_ms()) > 0) {
    event("service_stopped", "");
  }
  transaction.commit();
}

std::optional<Claim> Queue::claim(const ClaimRequest& request) {
  // Most calls find nothing: those take no write lock.
  const std::int64_t now = clock_->wall_ms();
  {
    Rows any = db_->query("SELECT 1 FROM jobs WHERE state = 'queued' AND follows = 0 LIMIT 1");
    if (!any.next()) return std::nullopt;
  }
  Transaction transaction(*db_);
  const auto [id, cached] = choose_job(*db_, request, now);
  if (id == 0) return std::nullopt;
  Claim claim;
  claim.token = random_token();
  claim.cached = cached;
  db_->run(
      "UPDATE jobs SET state = 'running', token = ?2, started_ms = ?3, reason = '', message = '', "
      "cancel_wanted = 0 WHERE id = ?1",
      id, claim.token, now);
  {
    Rows rows = db_->query("SELECT coalesce(max(number), 0) + 1 FROM attempts WHERE job = ?1", id);
    rows.next();
    claim.number = static_cast<int>(rows.integer(0));
  }
  const std::string engine = cached ? "cache" : request.engine;
  db_->run(
      "INSERT INTO attempts(token, job, number, engine, service, phase, lease_boot, "
      "lease_until_steady_ms, started_ms) VALUES(?1, ?2, ?3, ?4, ?5, 'waiting', ?6, ?7, ?8)",
      claim.token, id, claim.number, engine, request.service, clock_->boot_id(),
      clock_->steady_ms() + kLeaseMs, now);
  event("started", fmt::format("attempt {}, {}", claim.number, engine), id, claim.token);
  {
    Rows rows = db_->query(detail::kSelectJobs + "WHERE j.id = ?1", id);
    rows.next();
    claim.job = detail::read_job(rows);
  }
  read_work(*db_, id, claim);
  transaction.commit();
  return claim;
}

std::int64_t Queue::claimable() {
  const std::int64_t now = clock_->wall_ms();
  Rows rows = db_->query(
      "SELECT count(*) FROM (SELECT 1 FROM jobs INDEXED BY jobs_to_claim WHERE state = 'queued' "
      "AND follows = 0 AND (not_before_ms <= ?1 OR not_before_ms > ?1 + ?2) LIMIT 10000)",
      now, kLongestDelayMs);
  return rows.next() ? rows.integer(0) : 0;
}

std::int64_t Queue::unfinished() {
  Rows rows =
      db_->query("SELECT coalesce(sum(jobs), 0) FROM counts WHERE state IN ('queued', 'running')");
  return rows.next() ? rows.integer(0) : 0;
}

bool Queue::attempt_is_open(const std::string& token) {
  Rows rows = db_->query("SELECT 1 FROM attempts WHERE token = ?1 AND phase <> 'ended'", token);
  return rows.next();
}

void Queue::record_start(const std::string& token, const std::string& engine_id, int threads,
                         std::int64_t memory_mb) {
  db_->run(
      "UPDATE attempts SET engine_id = ?2, threads = ?3, memory_mb = ?4 WHERE token = ?1 "
      "AND phase <> 'ended'",
      token, engine_id, threads, memory_mb);
}

std::vector<std::string> Queue::renew(const std::string& service,
                                      const std::vector<std::string>& tokens,
                                      const std::string& doing) {
  std::vector<std::string> lost;
  Transaction transaction(*db_);
  const std::int64_t until = clock_->steady_ms() + kLeaseMs;
  for (const std::string& token : tokens) {
    const std::int64_t kept = db_->run(
        "UPDATE attempts SET lease_until_steady_ms = ?3, lease_boot = ?4 WHERE token = ?1 "
        "AND service = ?2 AND phase <> 'ended'",
        token, service, until, clock_->boot_id());
    if (kept == 0) lost.push_back(token);
  }
  db_->run("UPDATE services SET seen_ms = ?2, doing = ?3 WHERE id = ?1", service, clock_->wall_ms(),
           doing);
  transaction.commit();
  return lost;
}

void Queue::record_progress(const std::vector<Progress>& progress) {
  if (progress.empty()) return;
  Transaction transaction(*db_);
  for (const Progress& p : progress) {
    db_->run(
        "UPDATE attempts SET stage = ?2, fraction = ?3, layers_done = ?4, node = ?5, phase = "
        "CASE phase WHEN 'waiting' THEN 'working' ELSE phase END WHERE token = ?1 "
        "AND phase <> 'ended'",
        p.token, p.stage, p.fraction, p.layers_done, p.node);
  }
  transaction.commit();
}

bool Queue::begin_commit(const std::string& token) {
  Transaction transaction(*db_);
  const std::int64_t changed = db_->run(
      "UPDATE attempts SET phase = 'committing' WHERE token = ?1 AND phase <> 'ended' "
      "AND EXISTS(SELECT 1 FROM jobs j WHERE j.token = ?1 AND j.state = 'running' "
      "AND NOT j.cancel_wanted)",
      token);
  transaction.commit();
  return changed > 0;
}

void Queue::end_attempt(const std::string& token, const AttemptEnd& end) {
  db_->run(
      "UPDATE attempts SET phase = 'ended', ended_ms = ?2, reason = ?3, message = ?4, exit_code = "
      "?5, wall_s = ?6, cpu_s = ?7, peak_mb = ?8, log = ?9, node = CASE ?10 WHEN '' THEN node "
      "ELSE ?10 END, fraction = CASE ?3 WHEN '' THEN 1 ELSE fraction END WHERE token = ?1 "
      "AND phase <> 'ended'",
      token, clock_->wall_ms(), name_of(end.reason), end.message, end.exit_code, end.wall_s,
      end.cpu_s, end.peak_mb, end.log, end.node);
}

bool Queue::finish(const std::string& token, const ResultRecord& result, const AttemptEnd& end,
                   bool from_cache) {
  Transaction transaction(*db_);
  const std::int64_t now = clock_->wall_ms();
  JobId id = 0;
  std::string key, rate_class;
  int threads = 1;
  double units = 0;
  {
    Rows rows = db_->query(
        "SELECT j.id, j.key, w.rate_class, a.threads, coalesce(t.voxel_angle_steps, w.voxels) "
        "FROM jobs j JOIN works w ON w.key = j.key LEFT JOIN tomo_works t ON t.key = j.key "
        "JOIN attempts a ON a.token = j.token WHERE j.token = ?1 "
        "AND j.state = 'running' AND a.phase = 'committing'",
        token);
    if (!rows.next()) return false;
    id = rows.integer(0);
    key = rows.text(1);
    rate_class = rows.text(2);
    threads = static_cast<int>(rows.integer(3));
    units = rows.number(4);
  }
  end_attempt(token, end);
  const std::string files = detail::files_json(result.files);
  std::string message = end.message;
  if (from_cache) {
    // What was wrong with the inputs when the result was made; the same inputs have the same.
    Rows rows = db_->query(
        "SELECT message FROM jobs WHERE key = ?1 AND state = 'done' AND message <> '' LIMIT 1",
        key);
    if (rows.next()) message = rows.text(0);
  }
  db_->run(
      "UPDATE jobs SET state = 'done', token = '', reason = '', message = ?5, ended_ms = ?2, "
      "from_cache = ?3, files = ?4 WHERE id = ?1",
      id, now, from_cache,
      detail::files_json(result.delivered.empty() ? result.files : result.delivered), message);
  if (from_cache) {
    db_->run("UPDATE results SET used_ms = ?2 WHERE key = ?1", key, now);
  } else {
    std::int64_t bytes = 0;
    for (const ResultFile& f : result.files) bytes += f.bytes;
    const ResultFigures& f = result.figures;
    db_->run(
        "INSERT OR REPLACE INTO results VALUES(?1, 1, ?2, ?3, ?4, ?5, ?5, ?6, ?7, ?8, ?9, ?10, "
        "?11, ?12, ?13, ?14, ?15)",
        key, files, bytes, result.program, now, result.wall_s, f.layers, f.height_mean_um,
        f.height_p95_um, f.height_max_um, f.lost_features, f.merged_features, f.cure_through_voxels,
        f.undercure_voxels, f.target_voxels);
    if (f.tomo) {
      db_->run("INSERT OR REPLACE INTO tomo_results VALUES(?1, ?2, ?3, ?4, ?5, ?6, ?7)", key,
               f.tomo->contrast, f.tomo->contrast_bound, f.tomo->ver, f.tomo->turns,
               f.tomo->print_time_s, f.tomo->feasible);
    }
    if (f.time) {
      db_->run("INSERT OR REPLACE INTO stack_times VALUES(?1, ?2, ?3)", key, f.time->light_s,
               f.time->print_s);
    }
    if (f.verdict) {
      db_->run("INSERT OR REPLACE INTO stack_verdicts VALUES(?1, ?2, ?3)", key, f.verdict->outcome,
               f.verdict->words);
    }
    const double all_s = end.cpu_s > 0 ? end.cpu_s : end.wall_s * std::max(1, threads);
    const double core_s = std::max(all_s - kFixedJobS, 0.05 * all_s);
    db_->run(
        "INSERT INTO rates VALUES(?1, 1, ?2, ?3, ?4) ON CONFLICT DO UPDATE "
        "SET samples = samples + 1, voxels = voxels * ?5 + excluded.voxels, core_s = core_s * ?5 + "
        "excluded.core_s, bytes = bytes * ?5 + excluded.bytes",
        rate_class, units, core_s, static_cast<double>(bytes), kFading);
  }
  relead(key);
  event("done",
        from_cache ? std::string("from the cache")
                   : fmt::format("{} layers in {:.1f} s, {}", result.figures.layers, end.wall_s,
                                 in_words(result.figures)),
        id, token);
  transaction.commit();
  return true;
}

std::optional<JobState> Queue::give_up(const std::string& token, const AttemptEnd& given) {
  Transaction transaction(*db_);
  const std::int64_t now = clock_->wall_ms();
  AttemptEnd end = given;
  JobId id = 0;
  std::string key;
  int attempts = 0, delays = 0;
  std::int64_t lost = 0;
  {
    Rows rows = db_->query(
        "SELECT j.id, j.key, j.attempts, j.delays, j.cancel_wanted, (SELECT count(*) "
        "FROM attempts a WHERE a.job = j.id AND a.reason = 'lease_lost') FROM jobs j "
        "WHERE j.token = ?1 AND j.state = 'running'",
        token);
    if (rows.next()) {
      id = rows.integer(0);
      key = rows.text(1);
      attempts = static_cast<int>(rows.integer(2));
      delays = static_cast<int>(rows.integer(3));
      if (rows.integer(4) != 0) end.reason = Reason::cancelled;
      lost = rows.integer(5);
    }
  }
  if (id == 0) {
    // The job went on without this attempt; only its own end is written down.
    if (end.reason == Reason::none) end.reason = Reason::lease_lost;
    end_attempt(token, end);
    transaction.commit();
    return std::nullopt;
  }
  end_attempt(token, end);
  JobState now_is = JobState::queued;
  const FarmSettings settings = detail::read_settings(*db_);
  if (is_counted(end.reason)) ++attempts;
  bool again = is_retried(end.reason) && attempts < settings.max_attempts;
  if (end.reason == Reason::lease_lost && lost >= kMostLostLeases) again = false;
  if (again) {
    double delay_ms = 0;
    if (end.reason == Reason::disk_full) {
      delay_ms = 10'000.0 * (1 << std::min(delays, 6));
      ++delays;
    } else if (is_counted(end.reason)) {
      delay_ms = settings.retry_delay_s * 1000.0 * (1 << std::min(attempts - 1, 16));
    }
    const auto not_before =
        delay_ms > 0 ? now + std::min(static_cast<std::int64_t>(delay_ms), kLongestDelayMs) : 0;
    db_->run(
        "UPDATE jobs SET state = 'queued', token = '', reason = ?2, message = ?3, attempts = ?4, "
        "delays = ?5, not_before_ms = ?6, memory_failures = memory_failures + ?7, cancel_wanted = "
        "0 WHERE id = ?1",
        id, name_of(end.reason), end.message, attempts, delays, not_before,
        end.reason == Reason::out_of_memory);
    event("put_back", end.message, id, token, end.reason);
  } else {
    const bool cancelled = end.reason == Reason::cancelled;
    now_is = cancelled ? JobState::cancelled : JobState::failed;
    db_->run(
        "UPDATE jobs SET state = ?2, token = '', reason = ?3, message = ?4, attempts = ?5, "
        "ended_ms = ?6, cancel_wanted = 0 WHERE id = ?1",
        id, cancelled ? "cancelled" : "failed", name_of(end.reason), end.message, attempts, now);
    event(cancelled ? "cancelled" : "failed", end.message, id, token, end.reason);
    if (end.reason == Reason::bad_input || end.reason == Reason::infeasible) {
      // The same work fails the same way.
      std::vector<JobId> followers;
      {
        Rows rows = db_->query("SELECT id FROM jobs WHERE follows = ?1 AND state = 'queued'", id);
        while (rows.next()) followers.push_back(rows.integer(0));
      }
      for (const JobId follower : followers) {
        db_->run(
            "UPDATE jobs SET state = 'failed', follows = 0, reason = ?2, message = ?3, ended_ms = "
            "?4 WHERE id = ?1",
            follower, name_of(end.reason), end.message, now);
        event("failed", fmt::format("as job {}: {}", id, end.message), follower, {}, end.reason);
      }
    }
  }
  relead(key);
  transaction.commit();
  return now_is;
}

std::vector<std::string> Queue::cancellations(const std::string& service) {
  std::vector<std::string> tokens;
  Rows rows = db_->query(
      "SELECT a.token FROM attempts a JOIN jobs j ON j.token = a.token WHERE a.service = ?1 "
      "AND a.phase <> 'ended' AND j.cancel_wanted",
      service);
  while (rows.next()) tokens.push_back(rows.text(0));
  return tokens;
}

std::vector<OwnedAttempt> Queue::open_attempts(const std::string& service) {
  struct Raw {
    OwnedAttempt owned;
    detail::ProcessMark mark;
    std::string boot, lease_boot;
    std::int64_t lease_until = 0;
    bool stopped = false;
  };
  std::vector<Raw> raw;
  {
    Rows rows = db_->query(
        "SELECT a.token, coalesce(s.pid, 0), coalesce(s.process_start, 0), coalesce(s.boot, ''), "
        "a.lease_boot, a.lease_until_steady_ms, coalesce(s.stopped_ms, 1) <> 0 FROM attempts a "
        "LEFT JOIN services s ON s.id = a.service WHERE a.phase <> 'ended' "
        "AND (?1 = '' OR a.service = ?1)",
        service);
    while (rows.next()) {
      Raw r;
      r.owned.attempt.token = rows.text(0);
      r.mark.pid = rows.integer(1);
      r.mark.start = rows.integer(2);
      r.boot = rows.text(3);
      r.lease_boot = rows.text(4);
      r.lease_until = rows.integer(5);
      r.stopped = rows.integer(6) != 0;
      raw.push_back(std::move(r));
    }
  }
  std::vector<OwnedAttempt> list;
  for (Raw& r : raw) {
    {
      Rows rows = db_->query(detail::kSelectAttempts + "WHERE a.token = ?1", r.owned.attempt.token);
      if (!rows.next()) continue;
      r.owned.attempt = detail::read_attempt(rows);
    }
    {
      Rows rows = db_->query(detail::kSelectJobs + "WHERE j.id = ?1", r.owned.attempt.job);
      if (!rows.next()) continue;
      r.owned.job = detail::read_job(rows);
    }
    const std::string boot_id = clock_->boot_id();
    const detail::ProcessMark now = detail::mark_of(r.mark.pid);
    const bool same_boot = r.boot.starts_with(boot_id + " ");
    const bool same_space = r.boot == boot_text(*clock_, now);
    // In another space of numbers (a container) only the lease tells.
    r.owned.owner_alive = !r.stopped && same_boot && (!same_space || now.start == r.mark.start);
    r.owned.lease_expired = r.lease_boot != boot_id || clock_->steady_ms() > r.lease_until;
    list.push_back(std::move(r.owned));
  }
  return list;
}

std::vector<OwnedAttempt> Queue::orphans() {
  std::vector<OwnedAttempt> list = open_attempts("");
  std::erase_if(list, [](const OwnedAttempt& a) { return a.owner_alive && !a.lease_expired; });
  return list;
}

std::vector<OwnedAttempt> Queue::owned(const std::string& service) {
  return open_attempts(service);
}

bool Queue::adopt(const std::string& token, const std::string& service) {
  // Looked at again inside the transaction: two services may find the same orphan, or its owner
  // may have come back to renew.
  Transaction transaction(*db_);
  const std::vector<OwnedAttempt> list = orphans();
  const auto found = std::find_if(list.begin(), list.end(),
                                  [&](const OwnedAttempt& a) { return a.attempt.token == token; });
  if (found == list.end()) return false;
  db_->run(
      "UPDATE attempts SET service = ?2, lease_boot = ?3, lease_until_steady_ms = ?4 "
      "WHERE token = ?1 AND phase <> 'ended'",
      token, service, clock_->boot_id(), clock_->steady_ms() + kLeaseMs);
  event("service_lost", "its service is gone; another one looks after it", found->job.id, token);
  transaction.commit();
  return true;
}

}  // namespace slicecorr::farm
