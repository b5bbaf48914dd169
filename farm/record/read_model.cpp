// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/farm/read_model.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "record/rows.hpp"
#include "record/words.hpp"
#include "values/process_mark.hpp"

namespace slicecorr::farm {

using detail::Database;
using detail::Rows;
using Json = nlohmann::ordered_json;

namespace {

/// Jobs looked at for deadlines: a queue of 100,000 must not slow a status down.
constexpr std::int64_t kMostForDeadlines = 10'000;
/// Jobs whose real and expected times are compared.
constexpr int kRecentJobs = 50;

struct Condition {
  std::string sql;
  std::vector<std::string> values;  ///< as text; SQLite's affinity makes numbers of them
  bool few = false;                 ///< it names the few jobs that may fit
};

Condition condition_of(Database& db, const JobFilter& f) {
  Condition c;
  const auto add = [&](const std::string& sql, const std::string& value) {
    c.values.push_back(value);
    c.sql += c.sql.empty() ? "WHERE " : "AND ";
    std::string with_index = sql;
    const std::string place = fmt::format("?{}", c.values.size());
    for (std::size_t at; (at = with_index.find('@')) != with_index.npos;) {
      with_index.replace(at, 1, place);
    }
    c.sql += with_index + " ";
  };
  if (f.states.size() == 1) {
    // Not as a value: indexes of one state are found by its name in the text.
    c.sql = fmt::format("WHERE j.state = '{}' ", name_of(f.states[0]));
  } else if (!f.states.empty()) {
    std::vector<std::string> names;
    for (const JobState s : f.states) names.emplace_back(name_of(s));
    add("j.state IN (SELECT value FROM json_each(@))", detail::list_json(names));
  }
  if (!f.user.empty()) add("j.user = @", f.user);
  if (!f.label.empty()) add("j.id IN (SELECT job FROM job_labels WHERE label = @)", f.label);
  if (!f.text.empty()) {
    if (const auto few = detail::few_with(db, f.text)) {
      add("j.id IN (" + few->sql + ")", few->value);
      c.few = true;
    }
    add("(instr(j.name, @) > 0 OR instr(j.parts, @) > 0)", f.text);
  }
  if (f.batch > 0) add("j.batch = CAST(@ AS INTEGER)", std::to_string(f.batch));
  if (f.ended_since_ms > 0) {
    add("j.ended_ms >= CAST(@ AS INTEGER)", std::to_string(f.ended_since_ms));
  }
  if (f.with_message) c.sql += c.sql.empty() ? "WHERE j.message <> '' " : "AND j.message <> '' ";
  return c;
}

const char* order_of(JobFilter::Order order) {
  switch (order) {
    case JobFilter::Order::newest:
      return "ORDER BY j.id DESC ";
    case JobFilter::Order::urgency:
      return "ORDER BY j.priority DESC, j.ready_by_ms, j.id ";
    case JobFilter::Order::ended:
      return "ORDER BY j.ended_ms DESC, j.id DESC ";
    case JobFilter::Order::worst_height:
      return "ORDER BY r.height_max_um DESC, r.key, j.id ";
    default:
      return "ORDER BY j.id ";
  }
}

void count_jobs(Database& db, Summary& s) {
  Rows rows = db.query(
      "SELECT state, follower, sum(jobs), sum(expected_s), sum(from_cache) FROM counts "
      "GROUP BY state, follower");
  while (rows.next()) {
    const auto state = job_state_named(rows.text(0));
    if (!state) continue;
    s.jobs[static_cast<std::size_t>(*state)] += rows.integer(2);
    s.from_cache += rows.integer(4);
    if (*state != JobState::queued) continue;
    if (rows.integer(1)) {
      s.followers += rows.integer(2);
    } else {
      s.queued_s += std::max(0.0, rows.number(3));
    }
  }
}

void sum_attempts(Database& db, Summary& s) {
  Rows rows = db.query(
      "SELECT sum(attempts), coalesce(sum(CASE WHEN reason <> '' THEN attempts END), 0), "
      "coalesce(sum(CASE WHEN reason = '' THEN wall_s END), 0), coalesce(sum(CASE WHEN reason = "
      "'' THEN voxels END), 0) FROM attempt_totals WHERE engine <> 'cache'");
  if (rows.next()) {
    s.attempts = rows.integer(0);
    s.attempts_failed = rows.integer(1);
    s.busy_s = rows.number(2);
    s.voxels_done = rows.number(3);
  }
}

/// What the latest jobs really took, against what was expected of them.
double pace_of_latest(Database& db) {
  Rows rows = db.query(
      "SELECT sum(a.wall_s * max(a.threads, 1)), sum(j.expected_s) FROM (SELECT id, expected_s "
      "FROM jobs WHERE state = 'done' AND NOT from_cache ORDER BY ended_ms DESC LIMIT ?1) j "
      "JOIN attempts a ON a.job = j.id AND a.phase = 'ended' AND a.reason = ''",
      kRecentJobs);
  if (rows.next() && rows.number(0) > 0 && rows.number(1) > 0)
    return rows.number(0) / rows.number(1);
  return 1;
}

/// Jobs that will miss their deadlines. They are looked at in the order in which they start: each
/// ends when the work before it is done.
std::int64_t count_late(Database& db, double pace, int cores, std::int64_t now) {
  std::int64_t late = 0;
  double work_s = 0;
  const auto look_at = [&](Rows rows) {
    while (rows.next()) {
      work_s += rows.number(1) * pace;
      const std::int64_t ready_by = rows.integer(0);
      if (ready_by == kNoDeadline) continue;
      const double end_ms = static_cast<double>(now) + 1000 * work_s / std::max(1, cores);
      if (now > ready_by || end_ms > static_cast<double>(ready_by)) ++late;
    }
  };
  look_at(db.query("SELECT ready_by_ms, expected_s FROM jobs WHERE state = 'running'"));
  look_at(
      db.query("SELECT ready_by_ms, CASE WHEN follows = 0 THEN expected_s ELSE 0 "
               "END FROM jobs INDEXED BY jobs_queued WHERE state = 'queued' "
               "ORDER BY priority DESC, ready_by_ms, id LIMIT ?1",
               kMostForDeadlines));
  return late;
}

void measure_cache(Database& db, Summary& s) {
  Rows rows = db.query("SELECT count(*), coalesce(sum(bytes), 0) FROM results WHERE stored");
  if (rows.next()) {
    s.cache_entries = rows.integer(0);
    s.cache_bytes = rows.integer(1);
  }
}

}  // namespace

ReadModel::ReadModel(const std::string& path, const FarmClock& clock)
    : db_(std::make_unique<Database>(path, Database::Mode::read)), clock_(&clock) {}
ReadModel::~ReadModel() = default;
ReadModel::ReadModel(ReadModel&&) noexcept = default;

ReadModel::Snapshot::Snapshot(ReadModel& model) : model_(model) { model_.db_->execute("BEGIN"); }
ReadModel::Snapshot::~Snapshot() {
  try {
    model_.db_->execute("COMMIT");
  } catch (...) {
    // Nothing was written, so nothing can be lost.
  }
}

std::int64_t ReadModel::data_version() {
  Rows rows = db_->query("PRAGMA data_version");
  return rows.next() ? rows.integer(0) : 0;
}

std::vector<Job> ReadModel::jobs(const JobFilter& filter) {
  const Condition c = condition_of(*db_, filter);
  // Without another index few jobs are found by their numbers.
  std::string from = c.few ? "FROM jobs j NOT INDEXED " : "FROM jobs j ";
  if (filter.order == JobFilter::Order::worst_height) {
    // From the results in the order of their index; other jobs have no height error.
    from =
        c.few
            ? "FROM jobs j NOT INDEXED CROSS JOIN results r ON r.key = j.key AND j.state = 'done' "
            : "FROM results r CROSS JOIN jobs j ON j.key = r.key AND j.state = 'done' ";
  }
  if (!c.few && filter.order == JobFilter::Order::urgency && filter.states.size() == 1 &&
      filter.states[0] == JobState::queued) {
    from = filter.user.empty() ? "FROM jobs j INDEXED BY jobs_queued "
                               : "FROM jobs j INDEXED BY jobs_queued_of_user ";
  }
  std::string order = order_of(filter.order);
  if (c.sql.empty() && filter.order == JobFilter::Order::id) {
    // The same order, for jobs come into the record batch by batch; what is passed over is read from the index alone.
    from = "FROM jobs j INDEXED BY jobs_by_batch ";
    order = "ORDER BY j.batch, j.id ";
  }
  // Numbers first: what is passed over or sorted away needs nothing else. Both looks see one state,
  // inside a snapshot as well as outside.
  db_->execute("SAVEPOINT jobs");
  struct Release {
    Database& db;
    ~Release() {
      try {
        db.execute("RELEASE jobs");
      } catch (...) {
        // Nothing was written.
      }
    }
  } release{*db_};
  std::vector<JobId> ids;
  {
    Rows rows = db_->query_list("SELECT j.id " + from + c.sql + order +
                                    fmt::format("LIMIT {} OFFSET {}", filter.limit, filter.offset),
                                c.values);
    while (rows.next()) ids.push_back(rows.integer(0));
  }
  std::vector<Job> jobs;
  for (const JobId id : ids) {
    if (auto found = job(id)) jobs.push_back(std::move(*found));
  }
  return jobs;
}

std::int64_t ReadModel::count(const JobFilter& filter) {
  const Condition c = condition_of(*db_, filter);
  const bool plain = filter.label.empty() && filter.batch == 0 && filter.ended_since_ms == 0 &&
                     !filter.with_message;
  std::string from = "SELECT count(*) FROM jobs j ";
  if (plain && filter.text.empty()) {
    // Triggers keep counts of states and users.
    from = "SELECT coalesce(sum(j.jobs), 0) FROM counts j ";
  } else if (c.few) {
    from += "NOT INDEXED ";
  } else if (plain) {
    from += "INDEXED BY jobs_texts ";
  }
  Rows rows = db_->query_list(from + c.sql, c.values);
  return rows.next() ? rows.integer(0) : 0;
}

std::optional<Job> ReadModel::job(JobId id) {
  Rows rows = db_->query(detail::kSelectJobs + "WHERE j.id = ?1", id);
  if (!rows.next()) return std::nullopt;
  return detail::read_job(rows);
}

std::vector<Attempt> ReadModel::attempts(JobId id) {
  std::vector<Attempt> list;
  Rows rows = db_->query(detail::kSelectAttempts + "WHERE a.job = ?1 ORDER BY a.number", id);
  while (rows.next()) list.push_back(detail::read_attempt(rows));
  return list;
}

std::vector<RunningJob> ReadModel::running() {
  std::vector<RunningJob> list;
  {
    Rows rows =
        db_->query(detail::kSelectJobs + "WHERE j.state = 'running' ORDER BY j.started_ms, j.id");
    while (rows.next()) list.push_back({detail::read_job(rows), {}, 0, 0, -1});
  }
  const std::int64_t now = clock_->wall_ms();
  for (RunningJob& r : list) {
    Rows rows = db_->query(detail::kSelectAttempts + "WHERE a.token = ?1", r.job.token);
    if (!rows.next()) continue;
    r.attempt = detail::read_attempt(rows);
    r.seconds = std::max<double>(0, static_cast<double>(now - r.attempt.started_ms) / 1000);
    if (r.attempt.fraction > 0.02 && r.seconds > 0) {
      r.layers_per_s = r.attempt.layers_done / r.seconds;
      r.eta_s = r.seconds * (1 - r.attempt.fraction) / r.attempt.fraction;
    }
  }
  return list;
}

std::vector<FarmEvent> ReadModel::events(std::int64_t after, std::int64_t limit, JobId job) {
  const auto read = [](Rows& rows) {
    std::vector<FarmEvent> list;
    while (rows.next()) {
      list.push_back({rows.integer(0), rows.integer(1), rows.integer(2), rows.text(3), rows.text(4),
                      rows.text(6), reason_named(rows.text(5)), rows.text(7)});
    }
    return list;
  };
  if (job > 0) {
    Rows rows = db_->query(
        "SELECT e.seq, e.at_ms, e.job, e.attempt, e.kind, e.reason, e.text, coalesce(j.name, '') "
        "FROM events e LEFT JOIN jobs j ON j.id = e.job WHERE e.job = ?3 AND e.seq > ?1 "
        "ORDER BY e.seq LIMIT ?2",
        after, limit, job);
    return read(rows);
  }
  Rows rows = db_->query(
      "SELECT e.seq, e.at_ms, e.job, e.attempt, e.kind, e.reason, e.text, coalesce(j.name, '') "
      "FROM events e LEFT JOIN jobs j ON j.id = e.job WHERE e.seq > ?1 ORDER BY e.seq LIMIT ?2",
      after, limit);
  return read(rows);
}

std::vector<FarmEvent> ReadModel::last_events(std::int64_t limit) {
  std::int64_t last = 0;
  {
    Rows rows = db_->query("SELECT coalesce(max(seq), 0) FROM events");
    if (rows.next()) last = rows.integer(0);
  }
  return events(std::max<std::int64_t>(0, last - limit), limit);
}

std::vector<Reasons> ReadModel::failures() {
  std::vector<Reasons> list;
  Rows rows = db_->query(
      "SELECT reason, count(*) FROM jobs WHERE state = 'failed' GROUP BY reason "
      "ORDER BY count(*) DESC, reason");
  while (rows.next()) list.push_back({reason_named(rows.text(0)), rows.integer(1)});
  return list;
}

std::vector<AttemptTotals> ReadModel::attempt_totals() {
  std::vector<AttemptTotals> list;
  Rows rows = db_->query(
      "SELECT reason, engine, attempts, wall_s, cpu_s FROM attempt_totals ORDER BY reason, engine");
  while (rows.next()) {
    list.push_back({reason_named(rows.text(0)), rows.text(1), rows.integer(2), rows.number(3),
                    rows.number(4)});
  }
  return list;
}

std::vector<Service> ReadModel::services() {
  std::vector<Service> list;
  std::string boot = clock_->boot_id() + " ";
  Rows rows = db_->query(
      "SELECT id, engine, host, pid, started_ms, seen_ms, stopped_ms, doing, cores, memory_mb, "
      "boot, process_start FROM services ORDER BY stopped_ms = 0 DESC, started_ms DESC LIMIT 100");
  while (rows.next()) {
    Service s;
    s.id = rows.text(0);
    s.engine = rows.text(1);
    s.host = rows.text(2);
    s.pid = rows.integer(3);
    s.started_ms = rows.integer(4);
    s.seen_ms = rows.integer(5);
    s.stopped_ms = rows.integer(6);
    s.doing = rows.text(7);
    s.cores = static_cast<int>(rows.integer(8));
    s.memory_mb = rows.integer(9);
    const detail::ProcessMark now = detail::mark_of(s.pid);
    s.alive = s.stopped_ms == 0 && rows.text(10).starts_with(boot) &&
              (rows.text(10) != boot + now.space || now.start == rows.integer(11));
    list.push_back(std::move(s));
  }
  return list;
}

FarmSettings ReadModel::settings() { return detail::read_settings(*db_); }

std::vector<std::string> ReadModel::users() {
  std::vector<std::string> list;
  Rows rows = db_->query("SELECT DISTINCT user FROM counts WHERE jobs > 0 ORDER BY user");
  while (rows.next()) list.push_back(rows.text(0));
  return list;
}

Summary ReadModel::summary() {
  Summary s;
  count_jobs(*db_, s);
  sum_attempts(*db_, s);
  const double pace = pace_of_latest(*db_);
  for (const RunningJob& r : running()) {
    s.running_threads += r.attempt.threads;
    s.running_memory_mb += r.attempt.memory_mb;
    s.queued_s += r.job.expected_s * (1 - r.attempt.fraction);
  }
  s.queued_s *= pace;
  int cores = 0;
  for (const Service& service : services()) {
    if (service.alive) cores += service.cores;
  }
  const bool idle = s.jobs[static_cast<std::size_t>(JobState::queued)] +
                        s.jobs[static_cast<std::size_t>(JobState::running)] ==
                    0;
  s.eta_s = idle ? 0 : cores > 0 ? s.queued_s / cores : -1;
  if (!idle) s.late = count_late(*db_, pace, cores, clock_->wall_ms());
  measure_cache(*db_, s);
  const auto one = [&](const char* sql) {
    Rows rows = db_->query(sql);
    return rows.next() ? rows.integer(0) : 0;
  };
  s.first_submitted_ms = one("SELECT coalesce(min(submitted_ms), 0) FROM batches");
  s.last_ended_ms =
      one("SELECT max(coalesce((SELECT max(ended_ms) FROM jobs "
          "WHERE state = 'done'), 0), coalesce((SELECT max(ended_ms) FROM jobs "
          "WHERE state = 'failed'), 0))");
  s.last_event = one("SELECT coalesce(max(seq), 0) FROM events");
  return s;
}

}  // namespace slicecorr::farm
