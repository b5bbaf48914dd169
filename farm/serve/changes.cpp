// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// What changes the farm over HTTP: uploads, submissions, cancel, retry, priority, pause, resume.

#include <fmt/format.h>

#include <chrono>
#include <nlohmann/json.hpp>

#include "serve/api.hpp"
#include "serve/uploads.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/farm/queue.hpp"
#include "slicecorr/farm/status.hpp"
#include "support/http/guarded_server.hpp"
#include "support/json/read_json.hpp"

namespace slicecorr::farm::detail {

using Json = nlohmann::ordered_json;

namespace {

/// Jobs of an account are jobs of its user, whatever the request says; who operates may name others.
std::string with_user(const std::string& text, const Asker& asker) {
  Json json = parsed(text);
  if (asker.name.empty()) return text;
  Json& defaults = json["defaults"];
  if (defaults.is_null()) defaults = Json::object();
  if (!defaults.is_object()) return text;
  if (asker.role >= Role::operate) {
    if (!defaults.contains("user")) defaults["user"] = asker.name;
    return json.dump();
  }
  defaults["user"] = asker.name;
  const auto jobs = json.find("jobs");
  if (jobs != json.end() && jobs->is_array()) {
    for (Json& job : *jobs) {
      if (job.is_object()) job.erase("user");
    }
  }
  return json.dump();
}

}  // namespace

void not_there() { throw ApiError(404, "not_found", "there is nothing at this path"); }

void send_json(httplib::Response& response, int status, const Json& json) {
  send(response, status, json.dump(-1, ' ', false, Json::error_handler_t::replace) + "\n",
       kJsonType);
}

namespace {
/// No body has more: 2,000 jobs, or a resin.
constexpr slicecorr::detail::JsonBounds kBodyBounds{std::size_t{64} << 20, 16, 200'000};
}  // namespace

Json parsed(const std::string& text) {
  Json json = slicecorr::detail::try_json<Json>(text, kBodyBounds);
  if (!json.is_object()) throw ApiError(400, "json", "expected a JSON object");
  return json;
}

std::string Api::whole_body(const httplib::Request& request,
                            const httplib::ContentReader& body) const {
  const std::int64_t bytes = body_bytes(request, options_.most_body_bytes);
  std::string text;
  if (bytes == 0) return text;
  const bool whole = body([&](const char* data, std::size_t size) {
    text.append(data, size);
    return static_cast<std::int64_t>(text.size()) <= bytes;
  });
  if (!whole || static_cast<std::int64_t>(text.size()) != bytes) {
    http::GuardedStream::fail_body();
  }
  return text;
}

void Api::change(const httplib::Request& request, httplib::Response& response,
                 const httplib::ContentReader& body) {
  try {
    const Route* route = route_of(request.method, request.path);
    if (!route || !route->role) not_there();
    const Asker asker = accounts_.asker(request, *route->role, *route->role > Role::look);
    const std::string by = asker.name.empty() ? "api" : asker.name;
    const std::vector<std::string> path = segments_of(request.path);
    const std::string& what = path[2];
    if (what == "parts") return upload(path[3], request, response, body);
    if (what == "jobs" && path.size() == 3) return submit(asker, request, response, body);
    Query(request).end();
    const std::string text = whole_body(request, body);
    if (what == "pause" || what == "resume") return pause(what == "pause", by, response);
    if (what == "jobs") {
      return steer(id_of(path[3]), {path.begin() + 4, path.end()}, text, asker, response);
    }
    if (what == "studies" && path.size() == 3) return start_study(text, asker, response);
    if (what == "studies") {
      studies_.cancel(path[3], asker);
      return send_json(response, 200, {{"study", path[3]}, {"asked", true}});
    }
    if (what == "resins") return add_resin(text, by, response);
    if (what == "printers") return add_printer(text, response);
    if (what == "machines") return act_on_machine(path[3], path[4], text, response);
    if (what == "tickets") return give_ticket(text, response);
    not_there();
  } catch (const ApiError& e) {
    send_error(response, e.status, e.code, e.what());
  } catch (const InputError& e) {
    send_error(response, 400, "input", without_folders(e.what(), folder_));
  } catch (const InfeasibleError& e) {
    send_error(response, 422, "infeasible", without_folders(e.what(), folder_));
  } catch (const Cancelled&) {
    send_error(response, 503, "stopping", "the server is stopping");
  } catch (const DeviceError& e) {
    send_error(response, 503, "device", without_folders(e.what(), folder_));
  }
}

void Api::upload(const std::string& name, const httplib::Request& request,
                 httplib::Response& response, const httplib::ContentReader& body) {
  Query(request).end();
  const std::int64_t bytes = body_bytes(request, options_.most_upload_bytes);
  if (bytes == 0) throw ApiError(400, "body", "expected the bytes of a part");
  if (clean_uploads(folder_, options_.uploads_kept_s) + bytes > options_.most_uploads_bytes) {
    throw ApiError(507, "full", "too many parts wait for a submission");
  }
  {
    Reader reader(*this);
    const std::int64_t needed = reader->settings().min_free_mb << 20;
    for (const DiskState& d : disk_states(folder_)) {
      if (d.free_bytes >= 0 && d.free_bytes - bytes < needed) {
        throw ApiError(507, "full", "the farm's disk has no room for it");
      }
    }
  }
  Upload part(folder_, name);
  const bool whole = body([&](const char* data, std::size_t size) {
    if (stopping_ || part.bytes() + static_cast<std::int64_t>(size) > bytes) return false;
    part.write(data, size);
    return true;
  });
  if (!whole || part.bytes() != bytes) {
    http::GuardedStream::fail_body();
  }
  send_json(response, 201, {{"part", part.keep()}, {"bytes", bytes}});
}

Api::SubmitPlace::SubmitPlace(Api& api, std::string name) : api_(api), name_(std::move(name)) {
  const std::scoped_lock lock(api_.submit_mutex_);
  std::set<std::string>& now = api_.submitting_;
  if (now.size() >= kMostSubmissions || !now.insert(name_).second) {
    throw ApiError(503, "busy", "another submission is being checked");
  }
}
Api::SubmitPlace::~SubmitPlace() {
  const std::scoped_lock lock(api_.submit_mutex_);
  api_.submitting_.erase(name_);
}

void Api::submit(const Asker& asker, const httplib::Request& request, httplib::Response& response,
                 const httplib::ContentReader& body) {
  Query query(request);
  const bool dry_run = query.flag("dry_run");
  query.end();
  if (!options_.submit) throw ApiError(403, "read_only", "this server takes no jobs");
  const std::string text = with_user(whole_body(request, body), asker);
  const SubmitPlace place(*this, asker.name);
  SubmitReply reply = options_.submit(text, dry_run, stopping_);
  send(response, reply.status, std::move(reply.json), kJsonType);
}

void Api::pause(bool pause, const std::string& by, httplib::Response& response) {
  Queue queue(folder_.database(), *options_.clock);
  std::vector<std::pair<std::string, std::string>> changes{{"paused", pause ? "yes" : "no"}};
  if (!pause) changes.emplace_back("draining", "no");
  queue.change_settings(changes, by);
  send_json(response, 200, {{"paused", pause}});
}

Job Api::job_of(JobId id, const Asker& asker) {
  Reader reader(*this);
  auto job = id == 0 ? std::nullopt : reader->job(id);
  if (!job) throw ApiError(404, "not_found", "there is no such job");
  if (asker.role < Role::operate && job->user != asker.name) {
    throw ApiError(403, "role", "the job is somebody else's");
  }
  return *std::move(job);
}

void Api::steer(JobId id, const std::vector<std::string>& path, const std::string& text,
                const Asker& asker, httplib::Response& response) {
  const std::string& what = path[0];
  const std::string by = asker.name.empty() ? "api" : asker.name;
  const Job job = job_of(id, asker);
  if (what == "priority") return set_priority(id, text, by, response);
  if (what == "print") return print(id, text, by, response);
  if (what == "next") return next_print(job, text, asker, response);
  if (what == "scans") {
    return path.size() == 1 ? new_scan(job, text, asker, response)
                            : remove_scan(job, path[1], by, response);
  }
  Queue queue(folder_.database(), *options_.clock);
  if (what == "cancel") {
    switch (queue.cancel(id, by)) {
      case CancelOutcome::cancelled:
        return send_json(response, 200, {{"id", id}, {"state", "cancelled"}});
      case CancelOutcome::asked:
        return send_json(response, 202, {{"id", id}, {"state", "running"}, {"asked", true}});
      case CancelOutcome::too_late:
        throw ApiError(409, "too_late", "the job has ended, or its result is being written");
      case CancelOutcome::unknown:
        throw ApiError(404, "not_found", "there is no such job");
    }
  }
  if (!queue.retry(id, by)) {
    throw ApiError(
        409, "state",
        std::string("the job is ") + name_of(job.state) + ", expected failed or cancelled");
  }
  send_json(response, 200, {{"id", id}, {"state", "queued"}});
}

void Api::set_priority(JobId id, const std::string& text, const std::string& by,
                       httplib::Response& response) {
  const Json json = parsed(text);
  const auto priority = json.find("priority"), ready_by = json.find("ready_by");
  const bool has_priority = priority != json.end(), has_time = ready_by != json.end();
  if (json.empty() || json.size() != static_cast<std::size_t>(has_priority + has_time) ||
      (has_priority &&
       (!priority->is_number_integer() || std::abs(priority->get<double>()) > 1e6)) ||
      (has_time && !ready_by->is_string())) {
    throw ApiError(400, "json",
                   "expected {\"priority\": N, \"ready_by\": \"HH:MM\"}, or one of them, with a "
                   "whole number N");
  }
  // Both are checked before one is changed.
  std::int64_t ready_by_ms = kNoDeadline;
  if (has_time && *ready_by != "none") {
    const int minute = parse_minute(ready_by->get<std::string>());
    if (minute < 0) throw ApiError(400, "json", "ready_by: expected \"HH:MM\" or \"none\"");
    ready_by_ms = next_local_minute(options_.clock->wall_ms(), minute);
  }
  Queue queue(folder_.database(), *options_.clock);
  if ((has_priority && !queue.set_priority(id, priority->get<int>(), by)) ||
      (has_time && !queue.set_ready_by(id, ready_by_ms, by))) {
    Reader reader(*this);
    const auto job = reader->job(id);
    throw ApiError(
        409, "state",
        std::string("the job is ") + (job ? name_of(job->state) : "gone") + ", expected queued");
  }
  Json answer = {{"id", id}};
  if (has_priority) answer["priority"] = priority->get<int>();
  if (has_time) {
    answer["ready_by_ms"] = ready_by_ms == kNoDeadline ? Json(nullptr) : Json(ready_by_ms);
  }
  send_json(response, 200, answer);
}

}  // namespace slicecorr::farm::detail
