// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/farm/queue.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <optional>

#include "record/rows.hpp"
#include "slicecorr/error.hpp"

namespace slicecorr::farm {

using detail::Database;
using detail::Rows;
using detail::Transaction;

Queue::Queue(const std::string& path, const FarmClock& clock)
    : db_(std::make_unique<Database>(path, Database::Mode::create)), clock_(&clock) {}
Queue::~Queue() = default;
Queue::Queue(Queue&&) noexcept = default;

void Queue::event(const char* kind, const std::string& text, JobId job, const std::string& attempt,
                  Reason reason) {
  db_->run(
      "INSERT INTO events(at_ms, job, attempt, kind, reason, text) VALUES(?1, ?2, ?3, ?4, ?5, ?6)",
      clock_->wall_ms(), job, attempt, kind, name_of(reason), text);
}

void Queue::add_event(const std::string& kind, const std::string& text, JobId job) {
  event(kind.c_str(), text, job);
}

std::int64_t Queue::data_version() {
  Rows rows = db_->query("PRAGMA data_version");
  return rows.next() ? rows.integer(0) : 0;
}

/// Of the unfinished jobs with a key only one may work, the leader: the one that runs, else the
/// most urgent. The others follow it. With a result in the cache nobody has to wait.
void Queue::relead(const std::string& key) {
  JobId leader = 0;
  bool stored = false;
  {
    Rows rows = db_->query("SELECT 1 FROM results WHERE key = ?1 AND stored", key);
    stored = rows.next();
  }
  if (!stored) {
    Rows rows = db_->query(
        "SELECT id FROM jobs WHERE key = ?1 AND state IN ('queued', 'running') "
        "ORDER BY state = 'running' DESC, priority DESC, ready_by_ms, id LIMIT 1",
        key);
    if (rows.next()) leader = rows.integer(0);
  }
  if (leader == 0) {
    db_->run("UPDATE jobs SET follows = 0 WHERE key = ?1 AND state = 'queued' AND follows <> 0",
             key);
    return;
  }
  db_->run("UPDATE jobs SET follows = 0 WHERE id = ?1 AND follows <> 0", leader);
  db_->run(
      "UPDATE jobs SET follows = ?2 WHERE key = ?1 AND state = 'queued' AND id <> ?2 "
      "AND follows <> ?2",
      key, leader);
}

// --- submitting ---------------------------------------------------------------------------------

std::vector<JobId> Queue::submit(const std::vector<NewJob>& jobs, const std::string& user,
                                 const std::string& source, const std::vector<InputFile>& inputs) {
  Transaction transaction(*db_);
  const std::int64_t now = clock_->wall_ms();
  const FarmSettings settings = detail::read_settings(*db_);
  std::map<std::string, std::int64_t> per_user;
  for (const NewJob& j : jobs) ++per_user[j.user];
  for (const auto& [name, added] : per_user) {
    const int limit = queued_limit(settings, name);
    Rows rows = db_->query(
        "SELECT coalesce(sum(jobs), 0) FROM counts WHERE user = ?1 "
        "AND state IN ('queued', 'running')",
        name);
    const std::int64_t have = rows.next() ? rows.integer(0) : 0;
    if (limit > 0 && have + added > limit) {
      throw InputError(
          fmt::format("{} has {} unfinished jobs and would have {}; {} are allowed (user-queued)",
                      name, have, have + added, limit));
    }
  }
  for (const NewJob& j : jobs) {
    if (j.output_folder.empty()) continue;
    if (const JobId other = unfinished_output(j.output_folder, j.name)) {
      throw InputError(fmt::format("{}/{}: will be written by job {}, which is not finished",
                                   j.output_folder, j.name, other));
    }
  }
  db_->run("INSERT INTO batches(submitted_ms, user, source, jobs) VALUES(?1, ?2, ?3, ?4)", now,
           user, source, static_cast<std::int64_t>(jobs.size()));
  const std::int64_t batch = db_->last_id();
  std::vector<JobId> ids;
  std::string last_key;
  std::vector<std::string> keys;
  for (const NewJob& j : jobs) {
    const Work& w = j.work;
    if (w.key != last_key) {
      last_key = w.key;
      keys.push_back(w.key);
      db_->run("INSERT OR IGNORE INTO setups VALUES(?1, ?2)", w.setup_hash, w.setup_json);
      db_->run(
          "INSERT OR IGNORE INTO works VALUES(?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8, ?9, ?10, ?11, ?12)",
          w.key, w.spec_json, w.setup_hash, w.kind, w.printer, w.resin, w.format, w.rate_class,
          w.layers, w.voxels, w.base_memory_mb, w.thread_memory_mb);
      if (w.voxel_angle_steps > 0) {
        db_->run("INSERT OR IGNORE INTO tomo_works VALUES(?1, ?2)", w.key, w.voxel_angle_steps);
      }
      for (const std::string& file : w.input_files) {
        db_->run("INSERT OR IGNORE INTO work_inputs VALUES(?1, ?2)", w.key, file);
      }
    }
    db_->run(
        "INSERT INTO jobs(batch, state, name, user, labels, parts, priority, ready_by_ms, key, "
        "output_folder, expected_s, expected_bytes, submitted_ms) VALUES(?1, 'queued', ?2, ?3, ?4, "
        "?5, ?6, ?7, ?8, ?9, ?10, ?11, ?12)",
        batch, j.name, j.user, detail::list_json(j.labels), detail::list_json(j.parts), j.priority,
        j.ready_by_ms, w.key, j.output_folder, j.expected_s, j.expected_bytes, now);
    ids.push_back(db_->last_id());
    if (j.output_folder.empty()) {
      db_->run("UPDATE jobs SET output_folder = ?2 || id WHERE id = ?1", ids.back(),
               j.results_folder);
    }
    event("submitted", fmt::format("{} by {}", j.name, j.user), ids.back());
  }
  std::sort(keys.begin(), keys.end());
  keys.erase(std::unique(keys.begin(), keys.end()), keys.end());
  for (const std::string& key : keys) relead(key);
  for (const InputFile& input : inputs) {
    db_->run(
        "INSERT INTO inputs VALUES(?1, ?2, ?3) ON CONFLICT DO UPDATE "
        "SET added_ms = excluded.added_ms",
        input.file, input.bytes, now);
  }
  transaction.commit();
  return ids;
}

JobId Queue::unfinished_output(const std::string& folder, const std::string& name) {
  Rows rows = db_->query(
      "SELECT id FROM jobs WHERE output_folder = ?1 AND name = ?2 "
      "AND state IN ('queued', 'running') LIMIT 1",
      folder, name);
  return rows.next() ? rows.integer(0) : 0;
}

Rates Queue::rates(const std::string& rate_class) {
  Rates rates;
  Rows rows = db_->query("SELECT samples, voxels, core_s, bytes FROM rates WHERE rate_class = ?1",
                         rate_class);
  if (rows.next() && rows.number(2) > 0 && rows.number(1) > 0) {
    rates.samples = static_cast<int>(rows.integer(0));
    rates.units_per_s = rows.number(1) / rows.number(2);
    rates.bytes_per_unit = rows.number(3) / rows.number(1);
  }
  return rates;
}

// --- cache --------------------------------------------------------------------------------------

std::optional<ResultRecord> Queue::cached(const std::string& key) {
  Rows r = db_->query(
      "SELECT r.files, r.program, r.wall_s, r.layers, r.height_mean_um, r.height_p95_um, "
      "r.height_max_um, r.lost_features, r.merged_features, r.cure_through_voxels, "
      "r.undercure_voxels, r.target_voxels, t.contrast, t.contrast_bound, t.ver, t.turns, "
      "t.print_time_s, t.feasible, s.light_s, s.print_s, v.outcome, v.words FROM results r "
      "LEFT JOIN tomo_results t ON t.key = r.key LEFT JOIN stack_times s ON s.key = r.key "
      "LEFT JOIN stack_verdicts v ON v.key = r.key "
      "WHERE r.key = ?1 AND r.stored",
      key);
  if (!r.next()) return std::nullopt;
  ResultRecord result;
  result.files = detail::parse_files(r, 0);
  result.program = r.text(1);
  result.wall_s = r.number(2);
  ResultFigures& f = result.figures;
  f.layers = static_cast<int>(r.integer(3));
  f.height_mean_um = r.number(4);
  f.height_p95_um = r.number(5);
  f.height_max_um = r.number(6);
  f.lost_features = r.integer(7);
  f.merged_features = r.integer(8);
  f.cure_through_voxels = r.integer(9);
  f.undercure_voxels = r.integer(10);
  f.target_voxels = r.integer(11);
  f.tomo = detail::read_tomo_figures(r, 12);
  f.time = detail::read_stack_time(r, 12 + detail::kTomoColumns);
  f.verdict = detail::read_verdict(r, 12 + detail::kTomoColumns + detail::kTimeColumns);
  return result;
}

void Queue::forget_result(const std::string& key, const std::string& why) {
  Transaction transaction(*db_);
  if (db_->run("UPDATE results SET stored = 0 WHERE key = ?1 AND stored", key) > 0) {
    if (!why.empty()) event("cache_damaged", fmt::format("result {}: {}", key.substr(0, 12), why));
    relead(key);
  }
  transaction.commit();
}

std::vector<Queue::Collectable> Queue::results_by_age() {
  std::vector<Collectable> list;
  Rows r = db_->query(
      "SELECT key, bytes, used_ms, EXISTS(SELECT 1 FROM jobs j WHERE j.key = results.key "
      "AND j.state IN ('queued', 'running')) FROM results WHERE stored ORDER BY used_ms, key");
  while (r.next()) list.push_back({r.text(0), r.integer(1), r.integer(2), r.integer(3) != 0});
  return list;
}

std::vector<std::string> Queue::unneeded_inputs() {
  std::vector<std::string> files;
  Rows r = db_->query(
      "SELECT file FROM inputs WHERE NOT EXISTS(SELECT 1 FROM work_inputs i "
      "JOIN jobs j ON j.key = i.key WHERE i.file = inputs.file "
      "AND (j.state IN ('queued', 'running') OR EXISTS(SELECT 1 FROM scans s WHERE s.job = j.id "
      "AND NOT s.removed))) AND added_ms < ?1",
      clock_->wall_ms() - kInputGraceMs);
  while (r.next()) files.push_back(r.text(0));
  return files;
}

bool Queue::knows_input(const std::string& file) {
  Rows r = db_->query(
      "SELECT EXISTS(SELECT 1 FROM inputs WHERE file = ?1) OR EXISTS(SELECT 1 FROM work_inputs i "
      "JOIN jobs j ON j.key = i.key WHERE i.file = ?1 AND j.state IN ('queued', 'running'))",
      file);
  return r.next() && r.integer(0) != 0;
}

void Queue::forget_input(const std::string& file) {
  db_->run("DELETE FROM inputs WHERE file = ?1", file);
}

std::int64_t Queue::last_event() {
  Rows r = db_->query("SELECT coalesce(max(seq), 0) FROM events");
  return r.next() ? r.integer(0) : 0;
}

std::int64_t Queue::failed_since(std::int64_t event) {
  Rows r = db_->query(
      "SELECT count(*) FROM jobs WHERE state = 'failed' AND id IN (SELECT job FROM events "
      "WHERE seq > ?1 AND kind = 'failed')",
      event);
  return r.next() ? r.integer(0) : 0;
}

// --- people -------------------------------------------------------------------------------------

CancelOutcome Queue::cancel(JobId id, const std::string& by) {
  Transaction transaction(*db_);
  std::string state, key, phase;
  {
    Rows r = db_->query(
        "SELECT j.state, j.key, coalesce(a.phase, '') FROM jobs j "
        "LEFT JOIN attempts a ON a.token = j.token WHERE j.id = ?1",
        id);
    if (!r.next()) return CancelOutcome::unknown;
    state = r.text(0);
    key = r.text(1);
    phase = r.text(2);
  }
  CancelOutcome outcome = CancelOutcome::too_late;
  if (state == "queued") {
    db_->run(
        "UPDATE jobs SET state = 'cancelled', follows = 0, reason = 'cancelled', message = ?3, "
        "ended_ms = ?2 WHERE id = ?1",
        id, clock_->wall_ms(), "cancelled by " + by);
    event("cancelled", "by " + by, id, {}, Reason::cancelled);
    relead(key);
    outcome = CancelOutcome::cancelled;
  } else if (state == "running" && phase != "committing") {
    db_->run("UPDATE jobs SET cancel_wanted = 1 WHERE id = ?1", id);
    event("cancel_wanted", "by " + by, id);
    outcome = CancelOutcome::asked;
  }
  transaction.commit();
  return outcome;
}

bool Queue::retry(JobId id, const std::string& by) {
  Transaction transaction(*db_);
  const std::int64_t changed = db_->run(
      "UPDATE jobs SET state = 'queued', reason = '', message = '', attempts = 0, memory_failures "
      "= 0, delays = 0, not_before_ms = 0, cancel_wanted = 0, ended_ms = 0 WHERE id = ?1 "
      "AND state IN ('failed', 'cancelled')",
      id);
  if (changed == 0) return false;
  event("retried", "by " + by, id);
  std::string key;
  {
    Rows r = db_->query("SELECT key FROM jobs WHERE id = ?1", id);
    if (r.next()) key = r.text(0);
  }
  relead(key);
  transaction.commit();
  return true;
}

namespace {

/// The key of a job that has not ended.
std::optional<std::string> key_of_unfinished(detail::Database& db, JobId id) {
  Rows r = db.query("SELECT key FROM jobs WHERE id = ?1 AND state IN ('queued', 'running')", id);
  if (!r.next()) return std::nullopt;
  return r.text(0);
}

}  // namespace

bool Queue::set_priority(JobId id, int priority, const std::string& by) {
  Transaction transaction(*db_);
  const auto key = key_of_unfinished(*db_, id);
  if (!key) return false;
  db_->run("UPDATE jobs SET priority = ?2 WHERE id = ?1", id, priority);
  event("reprioritised", fmt::format("priority {} by {}", priority, by), id);
  relead(*key);
  transaction.commit();
  return true;
}

bool Queue::set_ready_by(JobId id, std::int64_t ready_by_ms, const std::string& by) {
  Transaction transaction(*db_);
  const auto key = key_of_unfinished(*db_, id);
  if (!key) return false;
  db_->run("UPDATE jobs SET ready_by_ms = ?2 WHERE id = ?1", id, ready_by_ms);
  event("reprioritised",
        ready_by_ms == kNoDeadline
            ? "no deadline, by " + by
            : fmt::format("ready by {}, by {}", local_time_text(ready_by_ms), by),
        id);
  relead(*key);
  transaction.commit();
  return true;
}

FarmSettings Queue::settings() { return detail::read_settings(*db_); }

void Queue::change_settings(const std::vector<std::pair<std::string, std::string>>& changes,
                            const std::string& by) {
  Transaction transaction(*db_);
  FarmSettings settings = detail::read_settings(*db_);
  const auto before = setting_texts(settings);
  for (const auto& [name, text] : changes) set_setting(settings, name, text);
  for (const auto& [name, text] : setting_texts(settings)) {
    const auto old = before.find(name);
    if (old != before.end() && old->second == text) continue;
    db_->run("INSERT INTO settings VALUES(?1, ?2) ON CONFLICT DO UPDATE SET value = excluded.value",
             name, text);
    if (name == "paused") {
      event(text == "yes" ? "paused" : "resumed", "by " + by);
    } else if (name == "draining" && text == "yes") {
      event("draining", "by " + by);
    } else if (name != "draining") {
      event("settings", fmt::format("{} = {}, by {}", name, text, by));
    }
  }
  transaction.commit();
}

}  // namespace slicecorr::farm
