// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/farm/as_printer.hpp"

#include <fmt/format.h>
#include <httplib.h>

#include <algorithm>
#include <chrono>
#include <map>
#include <mutex>
#include <nlohmann/json.hpp>
#include <sstream>

#include "machines/http_calls.hpp"
#include "serve/job_of_upload.hpp"
#include "serve/printer_login.hpp"
#include "serve/studies.hpp"
#include "serve/uploads.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/farm/queue.hpp"
#include "slicecorr/farm/read_model.hpp"
#include "slicecorr/version.hpp"
#include "support/http/answers.hpp"
#include "support/http/guard.hpp"
#include "support/http/guarded_server.hpp"
#include "support/json/members.hpp"
#include "support/json/read_json.hpp"
#include "support/text/display_text.hpp"

namespace slicecorr::farm {

namespace {

using Json = nlohmann::ordered_json;
using http::ApiError;

/// Beside the file's own bytes a form has this much: names, boundaries, short fields.
constexpr std::int64_t kFormBytes = 16 << 10;
constexpr std::size_t kMostFieldBytes = 1000;
/// Files wait so long for their job; as those of the farm's own server.
constexpr double kUploadsKeptS = 24 * 3600;
/// The machine is asked at most as often, however many slicers ask.
constexpr auto kLookAgain = std::chrono::seconds(2);
constexpr std::int64_t kMostListed = 100;

std::string dumped(const Json& json) {
  return json.dump(-1, ' ', false, Json::error_handler_t::replace) + "\n";
}

void answer(httplib::Response& response, int status, const Json& json) {
  http::send(response, status, dumped(json), http::kJsonType);
}

/// As PrusaLink says what is wrong; slicers show title and message.
void refuse(httplib::Response& response, const ApiError& e) {
  answer(response, e.status, {{"code", e.code}, {"title", "Not taken"}, {"message", e.what()}});
}

/// The file and the short fields of a form.
struct Form {
  std::map<std::string, std::string> fields;
  std::unique_ptr<detail::Upload> file;
  std::string file_name;
};

}  // namespace

struct PrinterServer::Parts {
  Parts(const FarmFolder& farm, AsPrinterOptions given)
      : folder(farm),
        options(std::move(given)),
        machine(machine_named(farm, options.machine)),
        login(options.key),
        room(farm, machine, options.times),
        // A slicer, a browser or two: not the farm's own crowd.
        server({.threads = 4, .most_slow = 8, .most_waiting = 32}) {}

  std::string version_text() const {
    // Slicers look at how it begins: each kind of print host at its own word.
    const char* begins = machine.kind == MachineKind::prusalink ? "Prusa SLA" : "OctoPrint 1.8.0";
    return fmt::format("{} (slicecorr {})", begins, version);
  }

  MachineView look() {
    const std::scoped_lock lock(look_mutex);
    const auto now = std::chrono::steady_clock::now();
    if (!seen || now - seen_at > kLookAgain) {
      seen = room.look();
      seen_at = std::chrono::steady_clock::now();
    }
    return *seen;
  }

  Json printer_json() {
    const MachineStatus s = look().status;
    const auto is = [&](MachineState state) { return s.state == state; };
    const Json flags = {{"operational", !is(MachineState::unknown)},
                        {"printing", is_print(s.state) && !is(MachineState::paused)},
                        {"paused", is(MachineState::paused)},
                        {"pausing", is(MachineState::pausing)},
                        {"cancelling", is(MachineState::stopping)},
                        {"error", is(MachineState::failed)},
                        {"ready", is_at_rest(s.state)},
                        {"finished", is(MachineState::finished)},
                        {"busy", is(MachineState::busy) || is(MachineState::checking) ||
                                     is(MachineState::uploading)}};
    std::string text = name_of(s.state);
    if (!s.trouble.empty()) text += ": " + s.trouble;
    return {{"state", {{"text", text}, {"flags", flags}}}};
  }

  Json job_json() {
    const MachineStatus s = look().status;
    Json file = {{"name", nullptr}};
    if (is_print(s.state)) file = {{"name", s.file}, {"path", s.file}, {"origin", "local"}};
    if (s.layers) file["layers"] = *s.layers;
    const auto seconds = [](const std::optional<double>& value) {
      return value ? Json(*value) : Json(nullptr);
    };
    Json progress = {{"completion", nullptr},
                     {"printTime", seconds(s.run_s)},
                     {"printTimeLeft", seconds(s.left_s)}};
    if (s.layer && s.layers && *s.layers > 0) {
      progress["completion"] = 100.0 * *s.layer / *s.layers;
    }
    return {{"state", name_of(s.state)}, {"job", {{"file", file}}}, {"progress", progress}};
  }

  /// What was sent here, with what became of it.
  Json files_json() {
    ReadModel model(folder.database());
    JobFilter filter;
    filter.label = "for " + machine.name;
    filter.order = JobFilter::Order::newest;
    filter.limit = kMostListed;
    Json list = Json::array();
    for (const Job& job : model.jobs(filter)) {
      list.push_back({{"name", job.name + "." + job.format},
                      {"path", job.name + "." + job.format},
                      {"origin", "local"},
                      {"type", "model"},
                      {"state", farm::name_of(job.state)},
                      {"message", job.message}});
    }
    return {{"files", list}};
  }

  Form read_form(const httplib::ContentReader& body);
  void take(const httplib::Request& request, httplib::Response& response,
            const httplib::ContentReader& body);
  void steer(const std::string& text);
  bool before_body(const httplib::Request& request, httplib::Response& response);
  void read(const httplib::Request& request, httplib::Response& response);
  void change(const httplib::Request& request, httplib::Response& response,
              const httplib::ContentReader& body);

  FarmFolder folder;
  AsPrinterOptions options;
  MachineSpec machine;
  detail::PrinterLogin login;
  MachineRoom room;
  std::mutex look_mutex;
  std::optional<MachineView> seen;
  std::chrono::steady_clock::time_point seen_at;
  std::mutex submit_mutex;
  http::GuardRules rules;
  http::GuardedServer server;
  int port = 0;
};

Form PrinterServer::Parts::read_form(const httplib::ContentReader& body) {
  Form form;
  std::string* field = nullptr;
  std::string trouble;
  const bool whole = body(
      [&](const httplib::MultipartFormData& part) {
        field = nullptr;
        if (part.name == "file" && !part.filename.empty()) {
          if (form.file) {
            trouble = "expected one file";
            return false;
          }
          // The last part of a path, whichever way its slashes lean; never a place of ours.
          form.file_name = part.filename.substr(part.filename.find_last_of("/\\") + 1);
          form.file = std::make_unique<detail::Upload>(folder, form.file_name);
          return true;
        }
        if (form.fields.size() >= 16 || part.name.size() > 100) {
          trouble = "has too many fields";
          return false;
        }
        field = &form.fields[part.name];
        return true;
      },
      [&](const char* data, std::size_t size) {
        if (server.stopping()) return false;
        if (field) {
          if (field->size() + size > kMostFieldBytes) {
            trouble = "has a field that is too long";
            return false;
          }
          field->append(data, size);
          return true;
        }
        if (!form.file) return false;
        if (form.file->bytes() + static_cast<std::int64_t>(size) > options.most_upload_bytes) {
          trouble = "the file is larger than this server takes";
          return false;
        }
        form.file->write(data, size);
        return true;
      });
  if (!trouble.empty()) throw ApiError(400, "form", trouble);
  if (!whole) http::GuardedStream::fail_body();
  return form;
}

void PrinterServer::Parts::take(const httplib::Request& request, httplib::Response& response,
                                const httplib::ContentReader& body) {
  if (!request.is_multipart_form_data()) {
    throw ApiError(415, "type", "expected a form with the field file");
  }
  if (detail::clean_uploads(folder, kUploadsKeptS) >= options.most_uploads_bytes) {
    throw ApiError(507, "full", "too many files wait for their jobs");
  }
  Form form = read_form(body);
  if (!form.file || form.file->bytes() == 0) {
    throw ApiError(400, "form", "expected the field file, with a file that is not empty");
  }
  const auto print = form.fields.find("print");
  if (print != form.fields.end() && print->second != "false" && !print->second.empty()) {
    throw ApiError(409, "start",
                   "nothing was taken: this printer corrects first and starts nothing by itself; "
                   "send the file without printing it");
  }
  const std::string name = form.file_name;
  const std::string part = form.file->keep();
  const std::scoped_lock lock(submit_mutex);
  const SubmitReply reply =
      options.submit(detail::job_of_upload(machine, part, name), false, server.stopping_flag());
  // The reasons, for whoever pressed the button.
  const std::string why = detail::refusal_of(reply);
  if (!why.empty()) throw ApiError(409, "job", why);
  const Json local = {{"name", name}, {"path", name}, {"origin", "local"}};
  response.set_header("Location", "/api/files/local/" + detail::path_segment(name));
  answer(response, 201, {{"done", true}, {"files", {{"local", local}}}, {"effectivePrint", false}});
}

void PrinterServer::Parts::steer(const std::string& text) {
  const Json json = slicecorr::detail::try_json<Json>(text, {1 << 16, 8, 100});
  const std::string command = slicecorr::detail::text_in(json, "command");
  const std::string action = slicecorr::detail::text_in(json, "action");
  try {
    // A stop is not kept waiting by who looks.
    MachineRoom now(folder, machine, options.times);
    if (command == "cancel") return now.stop();
    if (command == "pause" && action == "pause") return now.pause();
    if (command == "pause" && action == "resume") return now.resume();
  } catch (const InputError& e) {
    throw ApiError(409, "machine", e.what());
  }
  throw ApiError(409, "command",
                 "expected pause, resume or cancel: prints are started at the farm, by who has "
                 "looked at the plate");
}

bool PrinterServer::Parts::before_body(const httplib::Request& request,
                                       httplib::Response& response) {
  try {
    http::check_headers(rules, request);
    login.check(request, response);
    if (request.method == "GET" || request.method == "HEAD") {
      http::body_bytes(request, 0);
      read(request, response);
      return true;
    }
    if (request.method != "POST") throw ApiError(405, "method", "expected GET, HEAD or POST");
    const bool file = request.path == "/api/files/local";
    const std::int64_t bytes = http::body_bytes(
        request, file ? options.most_upload_bytes + kFormBytes : std::int64_t{1} << 16);
    if (http::GuardedStream* stream = http::GuardedStream::current()) stream->allow_body(bytes);
    return false;
  } catch (const ApiError& e) {
    refuse(response, e);
  } catch (const Error& e) {
    refuse(response, ApiError(503, "farm", detail::without_folders(e.what(), folder)));
  }
  return true;
}

void PrinterServer::Parts::read(const httplib::Request& request, httplib::Response& response) {
  const std::string& path = request.path;
  if (path == "/api/version") {
    return answer(response, 200,
                  {{"api", "0.1"},
                   {"server", version},
                   {"text", version_text()},
                   {"hostname", machine.name}});
  }
  if (path == "/api/printer") return answer(response, 200, printer_json());
  if (path == "/api/job") return answer(response, 200, job_json());
  if (path == "/api/files" || path == "/api/files/local") {
    return answer(response, 200, files_json());
  }
  throw ApiError(404, "not_found", "there is nothing at this path");
}

void PrinterServer::Parts::change(const httplib::Request& request, httplib::Response& response,
                                  const httplib::ContentReader& body) {
  try {
    if (request.path == "/api/files/local") return take(request, response, body);
    if (request.path != "/api/job") {
      throw ApiError(409, "command",
                     "prints are started at the farm, by who has looked at the plate");
    }
    std::string text;
    const bool whole = body([&](const char* data, std::size_t size) {
      text.append(data, size);
      return text.size() <= 1 << 16;
    });
    if (!whole) throw ApiError(400, "body", "the body is too long, or came too slowly");
    steer(text);
    http::send(response, 204, "", http::kJsonType);
  } catch (const ApiError& e) {
    refuse(response, e);
  } catch (const Cancelled&) {
    refuse(response, ApiError(503, "stopping", "the server is stopping"));
  } catch (const Error& e) {
    refuse(response, ApiError(503, "farm", detail::without_folders(e.what(), folder)));
  }
}

PrinterServer::PrinterServer(const FarmFolder& folder, AsPrinterOptions options)
    : parts_(std::make_unique<Parts>(folder, std::move(options))) {
  Parts& p = *parts_;
  if (p.options.key.size() < 8) {
    throw InputError("the farm as a printer wants a key of 8 characters at least");
  }
  detail::check_rule(p.machine);
  static_cast<void>(Queue(folder.database()));
  p.rules.loopback = http::is_loopback(p.options.host);
  std::istringstream names(p.options.host_names);
  for (std::string name; std::getline(names, name, ',');) {
    if (!name.empty()) p.rules.host_names.push_back(name);
  }
  auto& server = p.server;
  server.set_payload_max_length(static_cast<std::size_t>(p.options.most_upload_bytes + kFormBytes));
  p.port = server.bind(p.options.host, p.options.port);
  p.rules.port = p.port;
  using Handled = httplib::Server::HandlerResponse;
  server.set_pre_routing_handler(
      [&p](const httplib::Request& request, httplib::Response& response) {
        return p.before_body(request, response) ? Handled::Handled : Handled::Unhandled;
      });
  server.Post(".*",
              [&p](const httplib::Request& request, httplib::Response& response,
                   const httplib::ContentReader& body) { p.change(request, response, body); });
  server.set_post_routing_handler(
      [](const httplib::Request&, httplib::Response& response) { http::finish(response); });
}

PrinterServer::~PrinterServer() = default;
int PrinterServer::port() const { return parts_->port; }
std::string PrinterServer::address() const {
  return http::address_text(parts_->options.host, parts_->port);
}
void PrinterServer::run() { parts_->server.listen_after_bind(); }
void PrinterServer::stop() { parts_->server.stop_now(); }

}  // namespace slicecorr::farm
