// What changes the farm over HTTP: uploads, submissions, cancel, retry, priority, pause, resume.

#include <fmt/format.h>

#include <chrono>
#include <nlohmann/json.hpp>

#include "serve/api.hpp"
#include "serve/uploads.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/farm/queue.hpp"
#include "slicecorr/farm/status.hpp"

namespace slicecorr::farm::detail {

using Json = nlohmann::ordered_json;

namespace {

constexpr const char* kJsonType = "application/json; charset=utf-8";
constexpr const char* kBy = "api";

void send_json(httplib::Response& response, int status, const Json& json) {
  send(response, status, json.dump(-1, ' ', false, Json::error_handler_t::replace) + "\n",
       kJsonType);
}

Json parsed(const std::string& text) {
  Json json = Json::parse(text, nullptr, false);
  if (!json.is_object()) throw ApiError(400, "json", "expected a JSON object");
  return json;
}

}  // namespace

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
    throw ApiError(400, "body", "the body is shorter than announced, or came too slowly");
  }
  return text;
}

void Api::change(const httplib::Request& request, httplib::Response& response,
                 const httplib::ContentReader& body) {
  try {
    const std::vector<std::string> path = segments_of(request.path);
    const bool api = path.size() > 2 && path[0] == "api" && path[1] == "v1";
    if (api && request.method == "PUT" && path.size() == 4 && path[2] == "parts") {
      return upload(path[3], request, response, body);
    }
    if (api && request.method == "POST" && path.size() == 3 && path[2] == "jobs") {
      return submit(request, response, body);
    }
    if (api && request.method == "POST") return steer(path, request, response, body);
    throw ApiError(404, "not_found", "there is nothing at this path");
  } catch (const ApiError& e) {
    send_error(response, e.status, e.code, e.what());
  } catch (const InputError& e) {
    send_error(response, 400, "input", e.what());
  } catch (const InfeasibleError& e) {
    send_error(response, 422, "infeasible", e.what());
  } catch (const Cancelled&) {
    send_error(response, 503, "stopping", "the server is stopping");
  } catch (const DeviceError& e) {
    send_error(response, 503, "device", e.what());
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
    throw ApiError(400, "body", "the body is shorter than announced, or came too slowly");
  }
  send_json(response, 201, {{"part", part.keep()}, {"bytes", bytes}});
}

void Api::submit(const httplib::Request& request, httplib::Response& response,
                 const httplib::ContentReader& body) {
  Query query(request);
  const bool dry_run = query.flag("dry_run");
  query.end();
  if (!options_.submit) throw ApiError(403, "read_only", "this server takes no jobs");
  const std::string text = whole_body(request, body);
  parsed(text);
  // Reading meshes takes memory: one submission at a time.
  std::unique_lock lock(submit_mutex_, std::try_to_lock);
  if (!lock.owns_lock()) throw ApiError(503, "busy", "another submission is being checked");
  SubmitReply reply = options_.submit(text, dry_run, stopping_);
  send(response, reply.status, std::move(reply.json), kJsonType);
}

void Api::steer(const std::vector<std::string>& path, const httplib::Request& request,
                httplib::Response& response, const httplib::ContentReader& body) {
  Query(request).end();
  const auto not_there = [] { throw ApiError(404, "not_found", "there is nothing at this path"); };
  const std::string text = whole_body(request, body);
  if (path.size() == 3 && (path[2] == "pause" || path[2] == "resume")) {
    Queue queue(folder_.database(), *options_.clock);
    const bool pause = path[2] == "pause";
    std::vector<std::pair<std::string, std::string>> changes{{"paused", pause ? "yes" : "no"}};
    if (!pause) changes.emplace_back("draining", "no");
    queue.change_settings(changes, kBy);
    return send_json(response, 200, {{"paused", pause}});
  }
  if (path.size() != 5 || path[2] != "jobs") not_there();
  const JobId id = id_of(path[3]);
  const std::string& what = path[4];
  if (id == 0 || (what != "cancel" && what != "retry" && what != "priority")) not_there();
  Queue queue(folder_.database(), *options_.clock);
  const auto state_of = [&]() -> std::string {
    Reader reader(*this);
    const auto job = reader->job(id);
    if (!job) throw ApiError(404, "not_found", "there is no such job");
    return name_of(job->state);
  };
  if (what == "cancel") {
    switch (queue.cancel(id, kBy)) {
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
  if (what == "retry") {
    if (!queue.retry(id, kBy)) {
      throw ApiError(409, "state", "the job is " + state_of() + ", expected failed or cancelled");
    }
    return send_json(response, 200, {{"id", id}, {"state", "queued"}});
  }
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
  if ((has_priority && !queue.set_priority(id, priority->get<int>(), kBy)) ||
      (has_time && !queue.set_ready_by(id, ready_by_ms, kBy))) {
    throw ApiError(409, "state", "the job is " + state_of() + ", expected queued");
  }
  Json answer = {{"id", id}};
  if (has_priority) answer["priority"] = priority->get<int>();
  if (has_time) {
    answer["ready_by_ms"] = ready_by_ms == kNoDeadline ? Json(nullptr) : Json(ready_by_ms);
  }
  send_json(response, 200, answer);
}

}  // namespace slicecorr::farm::detail
