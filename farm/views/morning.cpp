// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/farm/morning.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <ctime>
#include <map>
#include <optional>

#include "record/rows.hpp"
#include "slicecorr/error.hpp"
#include "views/moment_text.hpp"

namespace slicecorr::farm {

using detail::Database;
using detail::Rows;

namespace {

/// Bars closer than this share of the time are drawn as one.
constexpr double kMergedShare = 1.0 / 1500;
constexpr int kMostLanes = 64;
constexpr std::int64_t kMostLogBytes = 16 << 10;

/// An attempt as the timeline needs it.
struct Span {
  std::int64_t job = 0, start_ms = 0, end_ms = 0;
  bool ended = false, final = false;  ///< final: the job failed with it
  Reason reason = Reason::none;
  std::string place, name;
  int number = 0;
  double cores = 0;  ///< kept busy on average
};

std::vector<Span> read_spans(Database& db, const MorningReport& r) {
  std::vector<Span> spans;
  std::map<std::int64_t, std::size_t> last_of_failed;  // by job, to its place in `spans`
  Rows rows = db.query(
      "SELECT a.job, a.started_ms, a.ended_ms, a.reason, a.node, a.engine, j.name, a.number, "
      "a.cpu_s, a.wall_s, a.threads, j.state = 'failed', CASE a.engine WHEN 'local' THEN s.host "
      "ELSE '' END FROM attempts a JOIN jobs j ON j.id = a.job "
      "LEFT JOIN services s ON s.id = a.service WHERE a.engine <> 'cache' AND a.started_ms < ?2 "
      "AND (a.ended_ms = 0 OR a.ended_ms > ?1) AND (?3 = 0 OR j.batch = ?3) "
      "ORDER BY a.started_ms, a.job",
      r.from_ms, r.until_ms, r.batch);
  while (rows.next()) {
    Span s;
    s.job = rows.integer(0);
    s.start_ms = rows.integer(1);
    s.ended = rows.integer(2) > 0;
    s.end_ms = s.ended ? rows.integer(2) : r.until_ms;
    s.end_ms = std::max(s.end_ms, s.start_ms);
    s.reason = reason_named(rows.text(3));
    // A worker that crashed could not say where it ran.
    s.place = !rows.text(4).empty()    ? rows.text(4)
              : !rows.text(12).empty() ? rows.text(12)
                                       : rows.text(5);
    if (rows.integer(11) != 0 && s.ended) last_of_failed[s.job] = spans.size();
    s.name = rows.text(6);
    s.number = static_cast<int>(rows.integer(7));
    const double seconds = static_cast<double>(s.end_ms - s.start_ms) / 1000;
    const double cpu_s = rows.number(8);
    // Without a measurement: as many as it was given.
    s.cores = cpu_s > 0 && seconds > 0 ? cpu_s / seconds
                                       : std::max<double>(1, static_cast<double>(rows.integer(10)));
    spans.push_back(std::move(s));
  }
  for (const auto& [job, i] : last_of_failed) spans[i].final = true;
  return spans;
}

MorningReport::BarKind kind_of(const Span& s) {
  using Kind = MorningReport::BarKind;
  if (!s.ended) return Kind::running;
  if (s.reason == Reason::none) return Kind::done;
  if (s.reason == Reason::cancelled) return Kind::cancelled;
  return is_retried(s.reason) && !s.final ? Kind::again : Kind::failed;
}

/// Attempts of a node go into its first free slot: what runs side by side is drawn side by side.
void fill_lanes(const std::vector<Span>& spans, MorningReport& r) {
  struct Lane {
    std::int64_t free_ms = 0;
    std::vector<MorningReport::Bar> bars;
  };
  std::map<std::string, std::vector<Lane>> places;
  const auto near_ms =
      static_cast<std::int64_t>(kMergedShare * static_cast<double>(r.until_ms - r.from_ms));
  int lanes = 0;
  for (const Span& s : spans) {
    std::vector<Lane>& here = places[s.place];
    auto lane = std::find_if(here.begin(), here.end(),
                             [&](const Lane& l) { return l.free_ms <= s.start_ms; });
    if (lane == here.end()) {
      if (lanes >= kMostLanes && !here.empty()) {
        lane = std::prev(here.end());
      } else {
        ++lanes;
        here.emplace_back();
        lane = std::prev(here.end());
      }
    }
    lane->free_ms = std::max(lane->free_ms, s.end_ms);
    MorningReport::Bar bar;
    bar.start_ms = std::max(s.start_ms, r.from_ms);
    bar.end_ms = std::min(s.end_ms, r.until_ms);
    bar.kind = kind_of(s);
    bar.job = s.job;
    if (!lane->bars.empty()) {
      MorningReport::Bar& last = lane->bars.back();
      const bool small = last.end_ms - last.start_ms < 8 * near_ms || last.jobs > 1;
      if (small && last.kind == bar.kind && bar.start_ms - last.end_ms <= near_ms &&
          bar.end_ms - bar.start_ms < 2 * near_ms) {
        last.end_ms = std::max(last.end_ms, bar.end_ms);
        ++last.jobs;
        continue;
      }
    }
    bar.words = fmt::format("job {} {}, attempt {}: {}", s.job, s.name, s.number,
                            !s.ended                   ? "running"
                            : s.reason == Reason::none ? "done"
                                                       : name_of(s.reason));
    bar.words += ", " + text::duration(static_cast<double>(s.end_ms - s.start_ms) / 1000);
    lane->bars.push_back(std::move(bar));
  }
  for (auto& [place, here] : places) {
    for (std::size_t i = 0; i < here.size(); ++i) {
      const int number = static_cast<int>(r.lanes.size());
      r.lanes.push_back(here.size() == 1 ? place : fmt::format("{} {}", place, i + 1));
      for (MorningReport::Bar& bar : here[i].bars) {
        bar.lane = number;
        if (bar.jobs > 1) bar.words = fmt::format("{} attempts from job {} on", bar.jobs, bar.job);
        r.bars.push_back(std::move(bar));
      }
    }
  }
}

/// A round length that makes at most 96 slots of the time.
std::int64_t slot_length(std::int64_t span_ms) {
  constexpr std::int64_t minute = 60'000;
  for (const std::int64_t ms :
       {std::int64_t{1000}, std::int64_t{5000}, std::int64_t{15'000}, minute, 5 * minute,
        10 * minute, 15 * minute, 30 * minute, 60 * minute, 180 * minute, 360 * minute}) {
    if (span_ms <= 96 * ms) return ms;
  }
  constexpr std::int64_t day = std::int64_t{1440} * minute;
  return (span_ms / (96 * day) + 1) * day;
}

void fill_slots(Database& db, const std::vector<Span>& spans, MorningReport& r) {
  r.slot_ms = slot_length(r.until_ms - r.from_ms);
  const auto slots = static_cast<std::size_t>((r.until_ms - r.from_ms + r.slot_ms - 1) / r.slot_ms);
  for (std::size_t i = 0; i < slots; ++i) {
    r.slots.push_back({r.from_ms + static_cast<std::int64_t>(i) * r.slot_ms, 0, 0});
  }
  {
    Rows rows = db.query(
        "SELECT (ended_ms - ?1) / ?3, count(*) FROM jobs WHERE state = 'done' AND ended_ms >= ?1 "
        "AND ended_ms < ?2 AND (?4 = 0 OR batch = ?4) GROUP BY 1",
        r.from_ms, r.until_ms, r.slot_ms, r.batch);
    while (rows.next()) {
      const auto i = static_cast<std::size_t>(rows.integer(0));
      if (i < r.slots.size()) r.slots[i].done = static_cast<double>(rows.integer(1));
    }
  }
  std::int64_t covered_ms = r.from_ms;
  for (const Span& s : spans) {
    const std::int64_t start = std::max(s.start_ms, r.from_ms),
                       end = std::min(s.end_ms, r.until_ms);
    if (end <= start) continue;
    r.core_s += s.cores * static_cast<double>(end - start) / 1000;
    // Spans come by their start, so what is covered grows in one direction.
    if (end > covered_ms) {
      r.working_s += static_cast<double>(end - std::max(start, covered_ms)) / 1000;
      covered_ms = end;
    }
    const auto first = static_cast<std::size_t>((start - r.from_ms) / r.slot_ms);
    for (std::size_t i = first; i < r.slots.size() && r.slots[i].from_ms < end; ++i) {
      const std::int64_t from = std::max(start, r.slots[i].from_ms);
      const std::int64_t to = std::min(end, r.slots[i].from_ms + r.slot_ms);
      // The last slot may be cut off by the end of the time.
      const std::int64_t length = std::min(r.slot_ms, r.until_ms - r.slots[i].from_ms);
      r.slots[i].cores_busy +=
          s.cores * static_cast<double>(to - from) / static_cast<double>(length);
    }
  }
}

/// Cores of the services that were there in the time; those of the largest of a machine, where
/// several shared it or came one after the other.
int cores_of_services(Database& db, const MorningReport& r) {
  Rows rows = db.query(
      "SELECT engine, host, max(cores) FROM services WHERE started_ms < ?2 "
      "AND max(seen_ms, stopped_ms) > ?1 GROUP BY engine, host",
      r.from_ms, r.until_ms);
  std::map<std::pair<std::string, std::string>, int> machines;
  while (rows.next()) {
    machines[{rows.text(0), rows.text(1)}] = static_cast<int>(rows.integer(2));
  }
  for (const Service& s : r.overview.services) {
    if (s.started_ms >= r.until_ms) continue;
    int& cores = machines[{s.engine, s.host}];
    cores = std::max(cores, s.cores);
  }
  int sum = 0;
  for (const auto& [machine, cores] : machines) sum += cores;
  return sum;
}

/// A young farm's report begins with its first event, not a day of nothing before it.
std::int64_t default_from_ms(Database& db, std::int64_t until_ms) {
  constexpr std::int64_t day_ms = 86'400'000, least_ms = 120'000;
  const std::int64_t day_before = until_ms - day_ms;
  Rows rows = db.query("SELECT at_ms FROM events ORDER BY seq LIMIT 1");
  if (!rows.next() || rows.integer(0) <= day_before) return day_before;
  const std::int64_t first = rows.integer(0) / 60'000 * 60'000;
  return std::max(day_before, std::min(first, until_ms - least_ms));
}

void read_failures(const FarmFolder& folder, Database& db, ReadModel& model,
                   const MorningOptions& options, MorningReport& r) {
  std::vector<JobId> ids;
  {
    Rows rows = db.query(
        "SELECT id FROM jobs WHERE state = 'failed' AND ended_ms >= ?1 AND ended_ms < ?2 "
        "AND (?3 = 0 OR batch = ?3) ORDER BY ended_ms DESC, id DESC LIMIT ?4",
        r.from_ms, r.until_ms, r.batch, options.most_failures);
    while (rows.next()) ids.push_back(rows.integer(0));
  }
  for (const JobId id : ids) {
    MorningReport::Failure f;
    if (auto job = model.job(id)) f.job = std::move(*job);
    f.attempts = model.attempts(id);
    if (!f.attempts.empty()) {
      const std::string log = log_tail(folder, f.attempts.back(), kMostLogBytes);
      for (std::size_t at = 0; at < log.size();) {
        const std::size_t end = std::min(log.find('\n', at), log.size());
        f.log_lines.push_back(text::printable(log.substr(at, end - at)));
        at = end + 1;
      }
      const auto most = static_cast<std::size_t>(std::max(0, options.log_lines));
      if (f.log_lines.size() > most) {
        f.log_lines.erase(f.log_lines.begin(), f.log_lines.end() - options.log_lines);
      }
    }
    r.failures.push_back(std::move(f));
  }
}

void read_worst(Database& db, const MorningOptions& options, MorningReport& r) {
  {
    Rows rows = db.query(detail::kSelectJobs +
                             "WHERE j.state = 'done' AND j.ended_ms >= ?1 AND j.ended_ms < ?2 "
                             "AND (?3 = 0 OR j.batch = ?3) AND w.kind <> 'tomo' "
                             "ORDER BY r.height_max_um DESC, j.id LIMIT ?4",
                         r.from_ms, r.until_ms, r.batch, options.most_worst);
    while (rows.next()) r.worst.push_back(detail::read_job(rows));
  }
  {
    // From the few tomographic prints to their jobs.
    Rows rows = db.query(
        "SELECT count(*) FROM tomo_results t JOIN jobs j ON j.key = t.key WHERE j.state = 'done' "
        "AND j.ended_ms >= ?1 AND j.ended_ms < ?2 AND (?3 = 0 OR j.batch = ?3)",
        r.from_ms, r.until_ms, r.batch);
    if (rows.next()) r.tomographic_done = rows.integer(0);
  }
  if (r.tomographic_done == 0) return;
  Rows rows = db.query(detail::kSelectJobs +
                           "WHERE j.state = 'done' AND j.ended_ms >= ?1 AND j.ended_ms < ?2 "
                           "AND (?3 = 0 OR j.batch = ?3) AND w.kind = 'tomo' "
                           "ORDER BY t.contrast, j.id LIMIT ?4",
                       r.from_ms, r.until_ms, r.batch, options.most_worst);
  while (rows.next()) r.tomographic.push_back(detail::read_job(rows));
}

void read_jobs(Database& db, const MorningOptions& options, MorningReport& r) {
  {
    Rows rows = db.query(
        "SELECT count(*) FROM jobs WHERE state = 'done' AND message <> '' AND ended_ms >= ?1 "
        "AND ended_ms < ?2 AND (?3 = 0 OR batch = ?3)",
        r.from_ms, r.until_ms, r.batch);
    if (rows.next()) r.with_defects = rows.integer(0);
  }
  Rows rows = db.query(detail::kSelectJobs +
                           "WHERE j.state IN ('done', 'failed', 'cancelled') AND j.ended_ms >= ?1 "
                           "AND j.ended_ms < ?2 AND (?3 = 0 OR j.batch = ?3) "
                           "ORDER BY j.ended_ms DESC, j.id DESC LIMIT ?4",
                       r.from_ms, r.until_ms, r.batch, options.most_jobs);
  while (rows.next()) r.jobs.push_back(detail::read_job(rows));
}

}  // namespace

std::int64_t moment_of(const std::string& text, std::int64_t now_ms, const std::string& option) {
  const auto wrong = [&]() -> std::int64_t {
    throw InputError(option + " is '" + text +
                     "', expected \"20:00\", \"2026-03-01 20:00\", \"90min\", \"36h\" or \"2d\"");
  };
  if (const int minute = parse_minute(text); minute >= 0) {
    // The last time that clocks showed it.
    constexpr std::int64_t day_ms = 86'400'000;
    std::int64_t then = next_local_minute(now_ms - 2 * day_ms, minute);
    for (std::int64_t next; (next = next_local_minute(then, minute)) <= now_ms;) then = next;
    return then;
  }
  std::tm t{};
  const char* rest = ::strptime(text.c_str(), "%Y-%m-%d %H:%M", &t);
  if (rest != nullptr && *rest == 0) {
    t.tm_isdst = -1;
    return std::int64_t{std::mktime(&t)} * 1000;
  }
  char* end = nullptr;
  const double number = std::strtod(text.c_str(), &end);
  const std::string unit = end;
  const double unit_s = unit == "min" ? 60 : unit == "h" ? 3600 : unit == "d" ? 86400 : 0;
  if (end == text.c_str() || unit_s == 0 || !(number > 0) || !(number < 1e6)) return wrong();
  return now_ms - static_cast<std::int64_t>(number * unit_s * 1000);
}

MorningReport read_morning(const FarmFolder& folder, ReadModel& model,
                           const MorningOptions& options, const FarmClock& clock) {
  MorningReport r;
  r.root = folder.root;
  r.overview = read_overview(model, folder, clock);
  // What ended in this very millisecond belongs to it.
  r.until_ms = options.until_ms > 0 ? options.until_ms : r.overview.now_ms + 1;
  r.batch = options.batch;
  Database db(folder.database(), Database::Mode::read);
  r.from_ms = options.from_ms > 0 ? options.from_ms : default_from_ms(db, r.until_ms);
  if (r.from_ms >= r.until_ms) {
    throw InputError("the time of the report ends before it begins (--since, --until)");
  }
  db.execute("BEGIN");
  {
    Rows rows = db.query(
        "SELECT state, reason, from_cache, count(*) FROM jobs "
        "WHERE state IN ('done', 'failed', 'cancelled') AND ended_ms >= ?1 AND ended_ms < ?2 "
        "AND (?3 = 0 OR batch = ?3) GROUP BY state, reason, from_cache ORDER BY count(*) DESC",
        r.from_ms, r.until_ms, r.batch);
    std::map<Reason, std::int64_t> reasons;
    while (rows.next()) {
      const std::int64_t n = rows.integer(3);
      if (rows.text(0) == "done") {
        r.done += n;
        if (rows.integer(2) != 0) r.from_cache += n;
      } else if (rows.text(0) == "failed") {
        r.failed += n;
        reasons[reason_named(rows.text(1))] += n;
      } else {
        r.cancelled += n;
      }
    }
    for (const auto& [reason, n] : reasons) r.failed_reasons.push_back({reason, n});
  }
  const std::vector<Span> spans = read_spans(db, r);
  r.attempts = static_cast<std::int64_t>(spans.size());
  std::map<Reason, std::int64_t> reasons;
  for (const Span& s : spans) {
    if (s.ended && s.reason != Reason::none) ++reasons[s.reason];
  }
  for (const auto& [reason, n] : reasons) r.attempt_reasons.push_back({reason, n});
  for (auto* list : {&r.failed_reasons, &r.attempt_reasons}) {
    std::stable_sort(list->begin(), list->end(),
                     [](const Reasons& a, const Reasons& b) { return a.jobs > b.jobs; });
  }
  fill_lanes(spans, r);
  fill_slots(db, spans, r);
  r.cores = cores_of_services(db, r);
  {
    Rows rows = db.query(
        "SELECT coalesce(sum(json_extract(f.value, '$.bytes')), 0) "
        "FROM jobs j, json_each(j.files) f WHERE j.state = 'done' AND j.files <> '' "
        "AND j.ended_ms >= ?1 AND j.ended_ms < ?2 AND (?3 = 0 OR j.batch = ?3)",
        r.from_ms, r.until_ms, r.batch);
    if (rows.next()) r.delivered_bytes = rows.integer(0);
  }
  {
    Rows rows = db.query("SELECT coalesce(sum(bytes), 0) FROM inputs");
    if (rows.next()) r.inputs_bytes = rows.integer(0);
  }
  read_failures(folder, db, model, options, r);
  read_worst(db, options, r);
  read_jobs(db, options, r);
  db.execute("COMMIT");
  r.scanned = prints_over_time(model);
  std::erase_if(r.scanned, [&](const PrintsOverTime& p) {
    return std::none_of(p.scans.begin(), p.scans.end(), [&](const KeptScan& s) {
      return s.at_ms >= r.from_ms && s.at_ms < r.until_ms;
    });
  });
  return r;
}

}  // namespace slicecorr::farm
