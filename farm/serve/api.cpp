// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "serve/api.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <charconv>
#include <nlohmann/json.hpp>

#include "serve/description.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/farm/metrics.hpp"
#include "slicecorr/farm/morning.hpp"
#include "slicecorr/farm/status.hpp"
#include "support/http/guarded_server.hpp"
#include "support/page/html_page.hpp"
#include "views/page_text.hpp"

namespace slicecorr::farm::detail {

using Json = nlohmann::ordered_json;

namespace {

/// Adds an item to the text of a JSON list that is not closed yet.
void add_item(std::string& list, const std::string& item) {
  if (list.back() != '[') list += ',';
  list += item;
}

JobFilter filter_of(Query& query) {
  JobFilter f;
  std::string states = query.text("state");
  while (!states.empty()) {
    const std::size_t comma = std::min(states.find(','), states.size());
    const auto state = job_state_named(states.substr(0, comma));
    if (!state) {
      throw ApiError(400, "state", "expected queued, running, done, failed or cancelled");
    }
    f.states.push_back(*state);
    states.erase(0, comma + 1);
  }
  f.user = query.text("user");
  f.label = query.text("label");
  f.text = query.text("text");
  constexpr std::int64_t most = std::int64_t{1} << 53;
  f.batch = query.number("batch", 0, 1, most);
  f.ended_since_ms = query.number("ended_since_ms", 0, 0, most);
  f.limit = query.number("limit", 100, 0, 1000);
  f.offset = query.number("offset", 0, 0, most);
  using Order = JobFilter::Order;
  const std::string order = query.text("order");
  if (order.empty() || order == "id") {
    f.order = Order::id;
  } else if (order == "newest") {
    f.order = Order::newest;
  } else if (order == "urgency") {
    f.order = Order::urgency;
  } else if (order == "ended") {
    f.order = Order::ended;
  } else if (order == "worst") {
    f.order = Order::worst_height;
  } else {
    throw ApiError(400, "order", "expected id, newest, urgency, ended or worst");
  }
  return f;
}

}  // namespace

// --- helpers ------------------------------------------------------------------------------------

std::vector<std::string> segments_of(const std::string& path) {
  std::vector<std::string> list;
  std::size_t at = path.starts_with('/') ? 1 : 0;
  while (at <= path.size()) {
    const std::size_t end = std::min(path.find('/', at), path.size());
    list.push_back(path.substr(at, end - at));
    at = end + 1;
  }
  return list;
}

std::int64_t id_of(const std::string& text) {
  std::int64_t id = 0;
  const auto [rest, error] = std::from_chars(text.data(), text.data() + text.size(), id);
  return error == std::errc{} && rest == text.data() + text.size() && id > 0 && text[0] != '0' ? id
                                                                                               : 0;
}

std::string Query::text(const char* name) {
  const auto n = params_.count(name);
  if (n == 0) return {};
  std::string value = params_.find(name)->second;
  if (n > 1 || value.size() > 500) throw ApiError(400, "query", "a parameter twice, or too long");
  params_.erase(name);
  return value;
}

std::int64_t Query::number(const char* name, std::int64_t otherwise, std::int64_t least,
                           std::int64_t most) {
  if (params_.count(name) == 0) return otherwise;
  const std::string value = text(name);
  std::int64_t n = 0;
  const auto [rest, error] = std::from_chars(value.data(), value.data() + value.size(), n);
  if (error != std::errc{} || rest != value.data() + value.size() || n < least || n > most) {
    throw ApiError(400, "query",
                   fmt::format("{}: expected a whole number from {} to {}", name, least, most));
  }
  return n;
}

bool Query::flag(const char* name) { return number(name, 0, 0, 1) != 0; }

void Query::end() const {
  if (!params_.empty()) throw ApiError(400, "query", "a parameter that this request does not have");
}

Api::Reader::Reader(Api& api) : api_(api) {
  {
    const std::scoped_lock lock(api_.readers_mutex_);
    if (!api_.readers_.empty()) {
      model_ = std::move(api_.readers_.back());
      api_.readers_.pop_back();
    }
  }
  if (!model_) {
    model_ = std::make_unique<ReadModel>(api_.folder_.database(), *api_.options_.clock);
  }
}

Api::Reader::~Reader() {
  const std::scoped_lock lock(api_.readers_mutex_);
  api_.readers_.push_back(std::move(model_));
}

// --- answers ------------------------------------------------------------------------------------

namespace {

std::vector<Account> all_accounts(const ServeOptions& options) {
  std::vector<Account> accounts = options.accounts;
  if (!options.token.empty()) accounts.push_back({"", Role::operate, options.token});
  return accounts;
}

}  // namespace

Api::Api(const FarmFolder& folder, const ServeOptions& options, GuardRules rules,
         const std::atomic<bool>& stopping)
    : folder_(folder),
      options_(options),
      rules_(std::move(rules)),
      stopping_(stopping),
      accounts_(all_accounts(options), rules_.loopback),
      studies_(folder, options.children),
      bridges_(folder, options.children),
      machines_(folder) {}

bool Api::before_body(const httplib::Request& request, httplib::Response& response) {
  try {
    check_headers(rules_, request);
    if (request.method == "GET" || request.method == "HEAD") {
      body_bytes(request, 0);
      read(request, response);
      return true;
    }
    if (request.method != "POST" && request.method != "PUT") {
      throw ApiError(405, "method", "expected GET, HEAD, POST or PUT");
    }
    const Route* route = route_of(request.method, request.path);
    const Role role = route && route->role ? *route->role : Role::look;
    accounts_.asker(request, role, !route || role > Role::look);
    const bool part = request.method == "PUT";
    const std::int64_t bytes =
        body_bytes(request, part ? options_.most_upload_bytes : options_.most_body_bytes);
    if (part && !request.has_header("Content-Length")) {
      throw ApiError(411, "length", "expected a Content-Length");
    }
    const std::string type = request.get_header_value("Content-Type");
    if (part ? type.starts_with("multipart/")
             : bytes > 0 && !type.starts_with("application/json")) {
      throw ApiError(415, "type",
                     part ? "expected the bytes of one file" : "expected application/json");
    }
    if (GuardedStream* stream = GuardedStream::current()) stream->allow_body(bytes);
    return false;
  } catch (const ApiError& e) {
    send_error(response, e.status, e.code, e.what());
  } catch (const InputError&) {
    send_error(response, 503, "record", "the farm's record can't be read");
  } catch (const DeviceError&) {
    send_error(response, 503, "record", "the farm's record can't be read now");
  }
  return true;
}

bool Api::read_shell(const std::string& path, httplib::Response& response) {
  const auto shell = [&](std::string text, const char* type) {
    send(response, 200, std::move(text), type);
    response.set_header("Content-Security-Policy", kShellPolicy);
    return true;
  };
  if (path == "/") return shell(std::string(page_live_html), kHtmlType);
  if (path == "/print") return shell(std::string(page_print_html), kHtmlType);
  if (path == "/machines") return shell(std::string(page_machines_html), kHtmlType);
  if (path == "/materials") return shell(std::string(page_materials_html), kHtmlType);
  if (path == "/api/v1/openapi.json") return shell(api_description(), kJsonType);
  if (path == "/healthz") return shell("ok\n", kTextType);
  if (path == "/pages/style.css") {
    return shell(page::style({page::page_tiles_css, page_farm_css, page_live_css, page_lab_css}),
                 "text/css; charset=utf-8");
  }
  constexpr std::pair<const char*, const std::string_view*> scripts[] = {
      {"common.js", &page_common_js},       {"live.js", &page_live_js},
      {"actions.js", &page_actions_js},     {"parts.js", &page_parts_js},
      {"plate.js", &page_plate_js},         {"print.js", &page_print_js},
      {"materials.js", &page_materials_js}, {"machines.js", &page_machines_js},
      {"scans.js", &page_scans_js}};
  for (const auto& [name, text] : scripts) {
    if (path == std::string("/pages/") + name) {
      return shell(std::string(*text), "text/javascript; charset=utf-8");
    }
  }
  return false;
}

void Api::read(const httplib::Request& request, httplib::Response& response) {
  const std::string& path = request.path;
  if (read_shell(path, response)) return;
  Query query(request);
  const std::string ticket = query.text("ticket");
  const Asker asker = !ticket.empty() && tickets_.valid(ticket, path)
                          ? Asker{}
                          : accounts_.asker(request, Role::look, false);
  if (!route_of("GET", path)) not_there();
  if (path == "/metrics") {
    query.end();
    return send(response, 200, metrics_.get([&] {
      Reader reader(*this);
      return metrics_text(*reader, folder_, *options_.clock) + machines_.metrics();
    }),
                "text/plain; version=0.0.4; charset=utf-8");
  }
  if (path == "/report") {
    query.end();
    const std::string html = report_.get([&] {
      return morning_page(morning(), {LinkTo::Kind::server, ""});
    });
    response.set_header("Content-Security-Policy", policy_for_styles(html));
    return send(response, 200, html, kHtmlType);
  }
  // The route says that there are at least three.
  const std::vector<std::string> parts = segments_of(path);
  if (parts[0] != "api") not_there();
  const std::string& what = parts[2];
  if (what == "jobs" && parts.size() > 3) {
    const JobId id = id_of(parts[3]);
    if (id == 0) not_there();
    return job(id, {parts.begin() + 4, parts.end()}, query, response);
  }
  if (what == "studies") {
    query.end();
    return read_study({parts.begin() + 3, parts.end()}, response);
  }
  if (what == "resins" && parts.size() > 3) {
    query.end();
    return resin_curve(parts[3], response);
  }
  if (what == "machines" && parts.size() > 3) {
    query.end();
    const std::string picture = machines_.picture(parts[3]);
    if (picture.empty()) throw ApiError(404, "not_found", "the machine has no picture");
    return send(response, 200, picture, "image/png");
  }
  read_farm(what, asker, query, response);
}

void Api::read_farm(const std::string& what, const Asker& asker, Query& query,
                    httplib::Response& response) {
  if (what == "jobs") return list_jobs(query, response);
  if (what == "events") return list_events(query, response);
  if (what.starts_with("drift")) return prints_wander(what, query, response);
  query.end();
  if (what == "overview") {
    return send(response, 200, overview_.get([&] {
      Reader reader(*this);
      return overview_json(read_overview(*reader, folder_, *options_.clock));
    }),
                kJsonType);
  }
  if (what == "report") {
    return send(response, 200, report_json_.get([&] { return morning_json(morning()); }),
                kJsonType);
  }
  if (what == "timeline.svg") {
    return send(response, 200, timeline_.get([&] { return timeline_svg(morning()); }),
                "image/svg+xml");
  }
  if (what == "me") {
    return send_json(response, 200, {{"name", asker.name}, {"role", name_of(asker.role)}});
  }
  if (what == "printers") {
    return send(response, 200, ask_program({"resinctl", "list", "--printers", "--json", "-"}),
                kJsonType);
  }
  if (what == "resins") {
    return send(response, 200, ask_program({"resinctl", "list", "--json", "-"}), kJsonType);
  }
  if (what == "machines") return send_json(response, 200, machines_.list());
  if (what == "bridges") return send_json(response, 200, {{"bridges", bridges_.list()}});
  not_there();
}

MorningReport Api::morning() {
  Reader reader(*this);
  return read_morning(folder_, *reader, {}, *options_.clock);
}

void Api::list_jobs(Query& query, httplib::Response& response) {
  const JobFilter filter = filter_of(query);
  query.end();
  Reader reader(*this);
  const ReadModel::Snapshot snapshot(*reader);
  const std::vector<Job> jobs = reader->jobs(filter);
  // What fits is counted already: to search a name means to look at all of them.
  const auto found = static_cast<std::int64_t>(jobs.size());
  const bool all =
      filter.offset == 0 && found < filter.limit && filter.order != JobFilter::Order::worst_height;
  const std::int64_t total = all ? found : reader->count(filter);
  std::string text = fmt::format(R"({{"total":{},"limit":{},"offset":{},"jobs":[)", total,
                                 filter.limit, filter.offset);
  for (const Job& j : jobs) add_item(text, job_json(j));
  return send(response, 200, text + "]}", kJsonType);
}

void Api::list_events(Query& query, httplib::Response& response) {
  const std::int64_t most = std::int64_t{1} << 53;
  const std::int64_t after = query.number("after", -1, 0, most);
  const std::int64_t limit = query.number("limit", 100, 1, 1000);
  const JobId of = query.number("job", 0, 1, most);
  query.end();
  Reader reader(*this);
  std::string text = R"({"events":[)";
  const std::vector<FarmEvent> events =
      after < 0 && of == 0 ? reader->last_events(limit)
                           : reader->events(std::max<std::int64_t>(0, after), limit, of);
  for (const FarmEvent& e : events) add_item(text, event_json(e));
  return send(response, 200, text + "]}", kJsonType);
}

void Api::job(JobId id, const std::vector<std::string>& rest, Query& query,
              httplib::Response& response) {
  Reader reader(*this);
  const auto job = reader->job(id);
  if (!job) throw ApiError(404, "not_found", "there is no such job");
  const auto attempts_text = [&] {
    std::string text = "[";
    for (const Attempt& a : reader->attempts(id)) add_item(text, attempt_json(a));
    return text + "]";
  };
  if (rest.empty()) {
    query.end();
    std::string text = job_json(*job);
    text.pop_back();
    Json after = nullptr;
    if (const auto next = reader->next_of(id)) {
      after = {{"job", next->of},
               {"edges_mean_um", next->before_mean_um},
               {"edges_p95_um", next->before_p95_um},
               {"words", next->words}};
    }
    return send(response, 200,
                text + R"(,"after_scans_of":)" +
                    after.dump(-1, ' ', false, Json::error_handler_t::replace) + R"(,"tries":)" +
                    attempts_text() + "}",
                kJsonType);
  }
  if (rest.size() == 1 && rest[0] == "log") {
    const std::int64_t number = query.number("attempt", 0, 1, 1'000'000);
    const std::int64_t bytes = query.number("bytes", 64 << 10, 1, 4 << 20);
    query.end();
    const std::vector<Attempt> attempts = reader->attempts(id);
    const auto found = number == 0
                           ? (attempts.empty() ? attempts.end() : std::prev(attempts.end()))
                           : std::find_if(attempts.begin(), attempts.end(),
                                          [&](const Attempt& a) { return a.number == number; });
    if (found == attempts.end()) throw ApiError(404, "not_found", "there is no such attempt");
    return send(response, 200, log_tail(folder_, *found, bytes), kTextType);
  }
  if (rest[0] == "scans") {
    query.end();
    return rest.size() == 1 ? list_scans(id, response)
                            : scan_file(id, rest[1], rest.back(), response);
  }
  if (rest.size() == 2 && rest[0] == "files") {
    query.end();
    return file(*job, rest[1], response);
  }
  throw ApiError(404, "not_found", "there is nothing at this path");
}

void Api::file(const Job& job, const std::string& ending, httplib::Response& response) {
  // Only what the record says was delivered, and only as long as it still has that size.
  const auto listed = std::find_if(job.files.begin(), job.files.end(),
                                   [&](const ResultFile& f) { return f.ending == ending; });
  if (listed == job.files.end()) throw ApiError(404, "not_found", "the job has no such output");
  const bool page = ending == "html";
  response.set_header("Content-Security-Policy", page ? kPartPolicy : kBarePolicy);
  const char* type = page ? kHtmlType : ending == "json" ? kJsonType : "application/octet-stream";
  const bool shown = page || ending == "json";
  send_file(job.output(ending), listed->bytes, type, shown ? "" : result_name(job.name, ending),
            response);
}

void send_file(const std::string& path, std::int64_t bytes, const char* type,
               const std::string& download, httplib::Response& response) {
  const int file = ::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK);
  struct stat s {};
  if (file < 0 || ::fstat(file, &s) != 0 || !S_ISREG(s.st_mode) ||
      (bytes >= 0 && s.st_size != bytes)) {
    if (file >= 0) ::close(file);
    throw ApiError(410, "gone", "the output was moved or changed since the job was done");
  }
  const std::shared_ptr<const int> handle(new int(file), [](const int* f) {
    ::close(*f);
    delete f;
  });
  if (!download.empty()) {
    std::string name;
    for (const char c : download) {
      const auto u = static_cast<unsigned char>(c);
      const bool plain = (u >= '0' && u <= '9') || (u >= 'A' && u <= 'Z') ||
                         (u >= 'a' && u <= 'z') || c == '-' || c == '_' || c == '.';
      name += plain ? std::string(1, c) : fmt::format("%{:02X}", u);
    }
    response.set_header("Content-Disposition", "attachment; filename*=UTF-8''" + name);
  }
  const auto size = static_cast<std::size_t>(s.st_size);
  if (size == 0) return response.set_content("", type);
  response.set_content_provider(
      size, type, [handle, size](std::size_t at, std::size_t left, httplib::DataSink& sink) {
        if (at > size || left > size - at) return false;
        char buffer[64 << 10];
        const ssize_t n =
            ::pread(*handle, buffer, std::min(left, sizeof buffer), static_cast<off_t>(at));
        return n > 0 && sink.write(buffer, static_cast<std::size_t>(n));
      });
}

}  // namespace slicecorr::farm::detail
