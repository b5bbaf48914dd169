// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/farm/status.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <nlohmann/json.hpp>

#include "support/json/read_json.hpp"
#include "views/moment_text.hpp"

namespace slicecorr::farm {

using Json = nlohmann::ordered_json;

namespace {

std::int64_t count_of(const Summary& s, JobState state) {
  return s.jobs[static_cast<std::size_t>(state)];
}

std::string night_text(const FarmSettings& s, std::int64_t now_ms) {
  if (s.night_from < 0) return {};
  return fmt::format("night window {}-{}, {}", minute_text(s.night_from),
                     minute_text(s.night_until),
                     in_night_window(s, local_minute(now_ms)) ? "open" : "closed");
}

/// What a job's line says besides its state: how far it is, or why it is where it is.
std::string remark(const Job& job, const std::map<JobId, const RunningJob*>& running,
                   std::int64_t now_ms) {
  using text::printable;
  switch (job.state) {
    case JobState::running: {
      const auto found = running.find(job.id);
      if (found == running.end()) return {};
      const RunningJob& r = *found->second;
      std::string text =
          fmt::format("{} {:.0f} %", r.attempt.stage.empty() ? r.attempt.phase : r.attempt.stage,
                      100 * r.attempt.fraction);
      if (job.layers > 0) {
        text += fmt::format(", {} of {} layers", r.attempt.layers_done, job.layers);
      }
      if (r.eta_s >= 0) text += ", " + text::duration(r.eta_s) + " left";
      if (r.attempt.number > 1) text += fmt::format(", attempt {}", r.attempt.number);
      if (job.cancel_wanted) text += ", to be cancelled";
      return printable(text);
    }
    case JobState::queued: {
      std::string text;
      if (job.follows > 0) text = fmt::format("waits for job {}, the same work", job.follows);
      if (job.reason != Reason::none) {
        text += fmt::format("{}again after {}: {}", text.empty() ? "" : "; ", name_of(job.reason),
                            printable(job.message));
      }
      if (job.not_before_ms > now_ms) {
        text += fmt::format(" (not before {})", text::moment(job.not_before_ms, now_ms));
      }
      return text;
    }
    case JobState::done: {
      std::string text = job.from_cache ? "from the cache" : "";
      if (job.figures) {
        text += (text.empty() ? "" : ", ") + in_words(*job.figures);
      }
      if (!job.message.empty()) {
        text += (text.empty() ? "" : "; ") + printable(text::without_folders(job.message));
      }
      return text;
    }
    case JobState::failed:
    case JobState::cancelled:
      break;
  }
  const std::string reason = name_of(job.reason), message = printable(job.message);
  return reason.empty() ? message : message.empty() ? reason : reason + ": " + message;
}

std::string joined(const std::vector<std::string>& list) {
  std::string text;
  for (const std::string& s : list) text += (text.empty() ? "" : ",") + s;
  return text::printable(text);
}

}  // namespace

StatusPage read_status(ReadModel& model, const FarmFolder& folder, const JobFilter& filter,
                       const FarmClock& clock) {
  StatusPage page;
  page.limit = filter.limit;
  page.offset = filter.offset;
  page.overview = read_overview(model, folder, clock);
  const ReadModel::Snapshot snapshot(model);
  page.total = model.count(filter);
  if (!filter.states.empty() || filter.order != JobFilter::Order::id || filter.offset > 0) {
    page.jobs = model.jobs(filter);
    return page;
  }
  using Order = JobFilter::Order;
  for (const auto& [state, order] :
       {std::pair{JobState::running, Order::id}, std::pair{JobState::queued, Order::urgency},
        std::pair{JobState::failed, Order::ended}, std::pair{JobState::cancelled, Order::ended},
        std::pair{JobState::done, Order::ended}}) {
    JobFilter part = filter;
    part.states = {state};
    part.order = order;
    part.limit = filter.limit - static_cast<std::int64_t>(page.jobs.size());
    // A long queue must not hide what failed.
    if (state == JobState::queued) part.limit -= part.limit / 2;
    if (part.limit <= 0) break;
    for (Job& job : model.jobs(part)) page.jobs.push_back(std::move(job));
  }
  return page;
}

std::string status_text(const StatusPage& page, const FarmFolder& folder, int columns) {
  const Overview& o = page.overview;
  const Summary& s = o.summary;
  std::string text;
  const auto line = [&](const std::string& words) {
    text += (columns > 0 ? text::clipped(words, columns) : words) + "\n";
  };
  line(text::printable(folder.root));
  line(fmt::format(
      "{} running, {} queued{}, {} done{}, {} failed, {} cancelled",
      text::count(count_of(s, JobState::running)), text::count(count_of(s, JobState::queued)),
      s.followers > 0 ? fmt::format(" ({} wait for the same work)", text::count(s.followers)) : "",
      text::count(count_of(s, JobState::done)),
      s.from_cache > 0 ? fmt::format(" ({} from the cache)", text::count(s.from_cache)) : "",
      text::count(count_of(s, JobState::failed)), text::count(count_of(s, JobState::cancelled))));
  if (count_of(s, JobState::running) + count_of(s, JobState::queued) > 0) {
    std::string left = "work left: " + text::duration(s.queued_s) + " on one core";
    if (s.eta_s >= 0) {
      left += ", done about " +
              text::moment(o.now_ms + static_cast<std::int64_t>(1000 * s.eta_s), o.now_ms);
    }
    if (s.late > 0) left += fmt::format("; {} will miss their time", text::count(s.late));
    line(left);
  }
  for (const Service& v : o.services) {
    line(
        text::printable(fmt::format("service: {} on {}, process {}, {} cores: {}", v.engine, v.host,
                                    v.pid, v.cores, v.doing.empty() ? "working" : v.doing)));
  }
  if (const std::string holds = what_holds(o); !holds.empty()) {
    line(count_of(s, JobState::queued) > 0 ? "nothing starts: " + holds : holds);
  }
  std::string disk = night_text(o.settings, o.now_ms);
  for (const DiskState& d : o.disks) {
    if (!disk.empty()) disk += "; ";
    disk +=
        fmt::format("free for the {}: {}", d.what, text::bytes(static_cast<double>(d.free_bytes)));
  }
  line(fmt::format("{}; cache: {} results, {}", disk, text::count(s.cache_entries),
                   text::bytes(static_cast<double>(s.cache_bytes))));

  if (page.jobs.empty()) {
    line("");
    line("no such jobs");
    return text;
  }
  std::map<JobId, const RunningJob*> running;
  for (const RunningJob& r : o.running) running[r.job.id] = &r;
  std::vector<std::vector<std::string>> rows;
  for (const Job& j : page.jobs) {
    const std::int64_t at = j.ended_ms > 0     ? j.ended_ms
                            : j.started_ms > 0 ? j.started_ms
                                               : j.submitted_ms;
    rows.push_back(
        {std::to_string(j.id), name_of(j.state), text::clipped(text::printable(j.name), 28),
         text::clipped(text::printable(j.user), 12), text::clipped(joined(j.labels), 16),
         std::to_string(j.priority),
         j.ready_by_ms == kNoDeadline ? "" : text::to_the_minute(j.ready_by_ms, o.now_ms),
         text::moment(at, o.now_ms), remark(j, running, o.now_ms)});
  }
  line("");
  text +=
      text::table({">ID", "STATE", "NAME", "USER", "LABELS", ">PRI", "READY BY", "SINCE", "REMARK"},
                  rows, columns);
  if (page.total > static_cast<std::int64_t>(page.jobs.size())) {
    line(fmt::format("{} of {} jobs", text::count(static_cast<std::int64_t>(page.jobs.size())),
                     text::count(page.total)));
  }
  return text;
}

std::string overview_line(const Overview& o) {
  const Summary& s = o.summary;
  std::string text = fmt::format(
      "{} running, {} queued, {} done, {} failed", text::count(count_of(s, JobState::running)),
      text::count(count_of(s, JobState::queued)), text::count(count_of(s, JobState::done)),
      text::count(count_of(s, JobState::failed)));
  if (s.eta_s > 0) text += "; " + text::duration(s.eta_s) + " left";
  for (const RunningJob& r : o.running) {
    text += fmt::format("; {} {} {:.0f} %", r.job.id, text::printable(r.job.name),
                        100 * r.attempt.fraction);
  }
  return text;
}

std::string status_json(const StatusPage& page, const FarmFolder& folder) {
  Json json = slicecorr::detail::own_json<Json>(overview_json(page.overview));
  json["dir"] = folder.root;
  json["total"] = page.total;
  json["limit"] = page.limit;
  json["offset"] = page.offset;
  json["list"] = Json::array();
  for (const Job& job : page.jobs)
    json["list"].push_back(slicecorr::detail::own_json<Json>(job_json(job)));
  return json.dump(2, ' ', false, Json::error_handler_t::replace);
}

}  // namespace slicecorr::farm
