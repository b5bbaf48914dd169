// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// What is told, and to whom.

#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <nlohmann/json.hpp>
#include <utility>

#include "slicecorr/error.hpp"
#include "slicecorr/farm/notify.hpp"
#include "slicecorr/verdict.hpp"
#include "support/files/text_file.hpp"
#include "support/toml/toml_table.hpp"

namespace slicecorr::farm {

using Json = nlohmann::ordered_json;

namespace {

constexpr std::int64_t kEventsAtOnce = 10'000;
constexpr std::size_t kMostSingleFailures = 20, kMostWarnings = 5;

[[noreturn]] void wrong(const std::string& path, const toml::source_region& where,
                        const std::string& message) {
  throw InputError(path, fmt::format("line {}", where.begin.line), message);
}

std::vector<std::string> texts(const std::string& path, const toml::node& node,
                               const std::string& what) {
  std::vector<std::string> list;
  if (const toml::array* array = node.as_array()) {
    for (const toml::node& each : *array) {
      if (!each.is_string()) wrong(path, node.source(), what + ": expected texts");
      list.push_back(each.as_string()->get());
    }
  } else {
    wrong(path, node.source(), what + ": expected a list of texts");
  }
  return list;
}

/// An address without what may be secret in it: user, password, query.
std::string told_url(const std::string& url) {
  const std::size_t begin = url.find("://") + 3;
  const std::size_t end = std::min(url.find_first_of("?#", begin), url.size());
  const std::size_t at = url.rfind('@', std::min(url.find('/', begin), end));
  const bool user = at != std::string::npos && at >= begin;
  return url.substr(0, begin) + url.substr(user ? at + 1 : begin, end - (user ? at + 1 : begin));
}

Notice make(const std::string& farm, const std::string& kind, const FarmEvent& e,
            const std::string& text, Json more) {
  Notice n;
  n.kind = kind;
  n.seq = e.seq;
  n.at_ms = e.at_ms;
  n.id = fmt::format("{}-{}-{}", farm, e.seq, kind);
  Json json = {{"id", n.id}, {"kind", kind}, {"at_ms", e.at_ms}, {"text", text}};
  json.update(more);
  n.json = json.dump(-1, ' ', false, Json::error_handler_t::replace);
  n.variables = {{"FARM_ID", n.id}, {"FARM_KIND", kind}, {"FARM_TEXT", text}};
  for (const auto& [key, value] : more.items()) {
    std::string name = "FARM_" + key;
    std::transform(name.begin(), name.end(), name.begin(),
                   [](char c) { return c >= 'a' && c <= 'z' ? static_cast<char>(c - 32) : c; });
    if (value.is_string()) n.variables.emplace_back(name, value.get<std::string>());
    if (value.is_number()) n.variables.emplace_back(name, value.dump());
  }
  // An environment can't hold a zero byte.
  for (auto& [name, value] : n.variables) std::erase(value, '\0');
  return n;
}

/// One key of a [[webhook]] or [[command]], `group`.
void take_key(const std::string& path, const std::string& group, const toml::key& name,
              const toml::node& value, NotifyTarget& t) {
  const std::string what(name.str());
  const auto number = [&](double least, double most) {
    const auto v = value.value<double>();
    if (!value.is_number() || !v || !(*v >= least && *v <= most)) {
      wrong(path, value.source(),
            fmt::format("{}: expected a number from {} to {}", what, least, most));
    }
    return *v;
  };
  if (what == "on") {
    t.kinds = texts(path, value, what);
    for (const std::string& kind : t.kinds) {
      if (std::find(std::begin(kNoticeKinds), std::end(kNoticeKinds), kind) ==
          std::end(kNoticeKinds)) {
        wrong(path, value.source(),
              "on: expected job_failed, batch_done, queue_empty, disk_low, "
              "machine_ended, machine_trouble or scan_beyond");
      }
    }
  } else if (what == "timeout_s") {
    t.timeout_s = number(0.1, 3600);
  } else if (what == "most_tries") {
    t.most_tries = static_cast<int>(number(1, 1000));
  } else if (group == "webhook" && what == "url" && value.is_string()) {
    t.url = value.as_string()->get();
    if (!t.url.starts_with("http://") && !t.url.starts_with("https://")) {
      wrong(path, value.source(), "url: expected http:// or https://");
    }
  } else if (group == "webhook" && what == "ca_file" && value.is_string()) {
    t.ca_file = value.as_string()->get();
  } else if (group == "webhook" && what == "headers") {
    t.headers = texts(path, value, what);
    for (const std::string& h : t.headers) {
      const std::size_t colon = h.find(": ");
      if (colon == 0 || colon == std::string::npos ||
          h.find_first_of("\r\n") != std::string::npos) {
        wrong(path, value.source(), "headers: expected \"Name: value\"");
      }
    }
  } else if (group == "command" && what == "run") {
    t.command = texts(path, value, what);
    if (t.command.empty() || !t.command[0].starts_with('/')) {
      wrong(path, value.source(), "run: expected a program with its whole path, and its arguments");
    }
  } else {
    wrong(path, value.source(),
          fmt::format("{} is not known in [[{}]], or of another kind; expected {}, on, "
                      "timeout_s, most_tries",
                      what, group, group == "webhook" ? "url, headers, ca_file" : "run"));
  }
}

NotifyTarget read_target(const std::string& path, const std::string& group,
                         const toml::node& node) {
  const toml::table* entry = node.as_table();
  if (entry == nullptr) wrong(path, node.source(), "expected [[webhook]] or [[command]]");
  NotifyTarget t;
  for (const auto& [name, value] : *entry) take_key(path, group, name, value, t);
  if (t.url.empty() && t.command.empty()) {
    wrong(path, node.source(), group == "webhook" ? "expected a url" : "expected run = [...]");
  }
  t.name = t.url.empty() ? "command " + t.command[0] : "webhook " + told_url(t.url);
  return t;
}

/// What jobs of a batch that are done warn of: open edges, bodies that hang on nothing and the like.
void add_warnings(ReadModel& model, std::int64_t batch, std::string& text, Json& more) {
  JobFilter warned;
  warned.batch = batch;
  warned.states = {JobState::done};
  warned.with_message = true;
  warned.limit = static_cast<std::int64_t>(kMostWarnings);
  const std::int64_t all = model.count(warned);
  if (all == 0) return;
  more["with_warnings"] = all;
  text += fmt::format("; {} done with a warning", all);
  const char* between = ": ";
  for (const Job& job : model.jobs(warned)) {
    more["warnings"].push_back({{"job", job.id}, {"name", job.name}, {"message", job.message}});
    text +=
        fmt::format("{}job {} {}: {}", std::exchange(between, "; "), job.id, job.name, job.message);
  }
}

}  // namespace

std::vector<NotifyTarget> read_notify_file(const std::string& path) {
  const auto text = text_of_file(path);
  if (!text) return {};
  const toml::table table = parse_toml(*text, path);
  std::vector<NotifyTarget> targets;
  for (const auto& [key, node] : table) {
    const std::string group(key.str());
    const toml::array* list = node.as_array();
    if ((group != "webhook" && group != "command") || list == nullptr) {
      wrong(path, node.source(), "expected [[webhook]] or [[command]]");
    }
    for (const toml::node& each : *list) {
      NotifyTarget t = read_target(path, group, each);
      // Names tell messages on their way apart.
      const auto same = std::count_if(targets.begin(), targets.end(), [&](const NotifyTarget& x) {
        return x.name == t.name || x.name.starts_with(t.name + " (");
      });
      if (same > 0) t.name += fmt::format(" ({})", same + 1);
      targets.push_back(std::move(t));
    }
  }
  return targets;
}

namespace {

/// What the prints of a batch come to, in words for its message, and in numbers; the gravest one's own
/// words with it. Empty where all are as designed.
std::string judged(ReadModel& model, std::int64_t batch, Json& more) {
  JobFilter filter;
  filter.batch = batch;
  filter.states = {JobState::done};
  filter.limit = kEventsAtOnce;
  std::int64_t look = 0, fails = 0;
  std::optional<Job> gravest;
  for (std::vector<Job> jobs = model.jobs(filter); !jobs.empty(); jobs = model.jobs(filter)) {
    for (Job& job : jobs) {
      const auto outcome = [](const Job& j) {
        return j.figures && j.figures->verdict ? j.figures->verdict->outcome : std::string();
      };
      const bool fail = outcome(job) == name_of(Outcome::fails);
      if (!fail && outcome(job) != name_of(Outcome::look)) continue;
      ++(fail ? fails : look);
      if (!gravest || (fail && outcome(*gravest) != name_of(Outcome::fails))) {
        gravest = std::move(job);
      }
    }
    filter.offset += filter.limit;
  }
  more["look"] = look;
  more["fails"] = fails;
  if (!gravest) return {};
  return fmt::format(
      "; {} to look at before printing, {} that will not hold or is another part; job {} {}: {}",
      look, fails, gravest->id, gravest->name, gravest->figures->verdict->words);
}

}  // namespace

Notices notices_since(ReadModel& model, const std::string& farm, std::int64_t after) {
  // One state for events and jobs: the last job of a batch must not end between two looks at it.
  const ReadModel::Snapshot snapshot(model);
  Notices found;
  found.seen = after;
  std::vector<std::pair<FarmEvent, Job>> failed;
  std::map<std::int64_t, FarmEvent> batches;  ///< the last event of each that ended a job
  std::optional<FarmEvent> last_end;
  for (bool more = true; more;) {
    more = false;
    for (const FarmEvent& e : model.events(found.seen, kEventsAtOnce)) {
      more = true;
      found.seen = e.seq;
      // The event's own words are the message.
      for (const char* kind : {"disk_low", "machine_ended", "machine_trouble", "scan_beyond"}) {
        Json more = Json::object();
        if (e.kind == "scan_beyond") more = {{"job", e.job}, {"name", e.name}};
        if (e.kind == kind) found.list.push_back(make(farm, kind, e, e.text, std::move(more)));
      }
      if (e.kind != "done" && e.kind != "failed" && e.kind != "cancelled") continue;
      const auto job = model.job(e.job);
      if (!job) continue;
      last_end = e;
      batches[job->batch] = e;
      if (e.kind == "failed") failed.emplace_back(e, *job);
    }
  }
  const auto failure = [&](const FarmEvent& e, const Job& job) {
    return make(
        farm, "job_failed", e,
        fmt::format("job {} {} failed ({}): {}", job.id, job.name, name_of(e.reason), e.text),
        {{"job", job.id},
         {"name", job.name},
         {"reason", name_of(e.reason)},
         {"message", e.text},
         {"user", job.user},
         {"batch", job.batch},
         {"labels", job.labels}});
  };
  if (failed.size() <= kMostSingleFailures) {
    for (const auto& [e, job] : failed) found.list.push_back(failure(e, job));
  } else {
    Json ids = Json::array();
    for (std::size_t i = 0; i < kMostSingleFailures; ++i) ids.push_back(failed[i].second.id);
    found.list.push_back(make(farm, "job_failed", failed.back().first,
                              fmt::format("{} jobs failed", failed.size()),
                              {{"jobs_failed", failed.size()}, {"first_jobs", ids}}));
  }
  for (const auto& [batch, e] : batches) {
    JobFilter open;
    open.batch = batch;
    open.states = {JobState::queued, JobState::running};
    open.limit = 1;
    if (!model.jobs(open).empty()) continue;
    Json more = {{"batch", batch}};
    std::string text = fmt::format("batch {}:", batch);
    for (const JobState state : {JobState::done, JobState::failed, JobState::cancelled}) {
      JobFilter filter;
      filter.batch = batch;
      filter.states = {state};
      const std::int64_t n = model.count(filter);
      more[name_of(state)] = n;
      text += fmt::format("{} {} {}", state == JobState::done ? "" : ",", n, name_of(state));
    }
    text += judged(model, batch, more);
    add_warnings(model, batch, text, more);
    found.list.push_back(make(farm, "batch_done", e, text, more));
  }
  if (last_end) {
    const Summary s = model.summary();
    const auto n = [&](JobState state) { return s.jobs[static_cast<std::size_t>(state)]; };
    if (n(JobState::queued) + n(JobState::running) == 0) {
      found.list.push_back(make(farm, "queue_empty", *last_end, "nothing is queued or running",
                                {{"done", n(JobState::done)},
                                 {"failed", n(JobState::failed)},
                                 {"cancelled", n(JobState::cancelled)}}));
    }
  }
  return found;
}

}  // namespace slicecorr::farm
