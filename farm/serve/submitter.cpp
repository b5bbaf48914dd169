// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Jobs that come over HTTP: read as a jobs file, kept inside the folders that they may use, then
// checked and queued as `slicefarm submit` does.

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>
#include <utility>

#include "serve/studies.hpp"
#include "serve/uploads.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/farm/read_model.hpp"
#include "slicecorr/farm/serve.hpp"
#include "slicecorr/farm/submit.hpp"
#include "submit/fields.hpp"

namespace slicecorr::farm {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

namespace {

/// Whether a path lies in one of the folders, links followed.
bool inside(const std::string& path, const std::vector<std::string>& folders) {
  if (!path.starts_with('/')) return false;
  std::error_code error;
  const fs::path real = fs::weakly_canonical(path, error);
  if (error) return false;
  return std::any_of(folders.begin(), folders.end(), [&](const std::string& folder) {
    std::error_code e;
    const fs::path root = fs::canonical(folder, e);
    if (e) return false;
    const auto [a, b] = std::mismatch(root.begin(), root.end(), real.begin(), real.end());
    return a == root.end();
  });
}

/// Printers and resins by name only: a path would be read, and told of in messages.
bool is_name(const std::string& text) {
  return text.find('/') == std::string::npos && !text.ends_with(".toml");
}

void confine(JobRequest& request, const SubmitRules& rules, std::vector<SubmitError>& errors) {
  const auto confine_input = [&](std::string& input, const char* key) {
    if (const std::string path = detail::upload_path(rules.folder, input); !path.empty()) {
      input = path;
    } else if (!inside(input, rules.allowed_folders)) {
      errors.push_back(
          {request.where, std::string(key) +
                              ": expected an uploaded one (\"upload:...\"), or a whole path in a "
                              "folder of --allow-dir"});
    }
  };
  try {
    detail::expand_copies(request);
  } catch (const InputError& e) {
    errors.push_back({request.where, e.what()});
    return;
  }
  for (std::string& part : request.parts) confine_input(part, "part");
  for (std::string& left : request.leave_alone) confine_input(left, "leave_alone");
  for (std::string& part : request.part_inside) confine_input(part, "part_inside");
  for (std::string& insert : request.inserts) confine_input(insert, "insert");
  if (!request.out.empty() && !inside(request.out, rules.allowed_folders)) {
    errors.push_back(
        {request.where, "out: expected none, or a whole path in a folder of --allow-dir"});
  }
  for (const std::string* name : {&request.setup.printer, &request.setup.resin}) {
    if (!is_name(*name) && !inside(*name, rules.allowed_folders)) {
      errors.push_back({request.where,
                        "printer, resin: expected a name, or a whole path in a folder of "
                        "--allow-dir"});
    }
  }
}

/// Refuses more jobs of a user than may wait.
void check_open_jobs(const std::vector<JobRequest>& requests, const SubmitRules& rules) {
  std::map<std::string, std::int64_t> asked;
  for (const JobRequest& r : requests) {
    asked[r.user.empty() ? rules.user : r.user] += std::max(1, r.copies);
  }
  ReadModel model(rules.folder.database());
  for (const auto& [user, jobs] : asked) {
    JobFilter open;
    open.user = user;
    open.states = {JobState::queued, JobState::running};
    const std::int64_t there = model.count(open);
    if (there + jobs <= rules.most_open_jobs) continue;
    throw SubmitErrors({{"request", fmt::format("{} has {} jobs that wait or run; with these {} it "
                                                "would be more than {}",
                                                user, there, jobs, rules.most_open_jobs)}});
  }
}

SubmitReply failed(const std::vector<SubmitError>& errors, const FarmFolder& folder) {
  Json list = Json::array();
  for (const SubmitError& e : errors) {
    if (list.size() == kMostErrorsTold) break;
    list.push_back({{"where", e.where},
                    {"message", detail::without_folders(e.message, folder)},
                    {"reason", name_of(e.reason)}});
    if (e.request >= 0) list.back()["job"] = e.request;
  }
  const Json json = {{"error",
                      {{"status", 400},
                       {"code", "jobs"},
                       {"message", fmt::format("{} {}; nothing was queued", errors.size(),
                                               errors.size() == 1 ? "error" : "errors")},
                       {"errors", list}}}};
  return {400, json.dump(-1, ' ', false, Json::error_handler_t::replace) + "\n"};
}

}  // namespace

std::function<SubmitReply(const std::string&, bool, const std::atomic<bool>&)> make_submitter(
    SubmitRules rules) {
  return [rules = std::move(rules)](const std::string& body, bool dry_run,
                                    const std::atomic<bool>& stopping) -> SubmitReply {
    try {
      std::vector<JobRequest> requests = parse_jobs_json(body, "request");
      std::vector<SubmitError> errors;
      for (JobRequest& request : requests) {
        const std::size_t known = errors.size();
        confine(request, rules, errors);
        for (std::size_t i = known; i < errors.size(); ++i) {
          errors[i].request = &request - requests.data();
        }
      }
      if (!errors.empty()) return failed(errors, rules.folder);
      check_open_jobs(requests, rules);
      Queue queue(rules.folder.database());
      ExecutionContext context;
      context.cancel = &stopping;
      // What `slicefarm submit` says on stderr.
      Json notices = Json::array();
      context.notice = [&](const std::string& text) {
        notices.push_back(detail::without_folders(text, rules.folder));
      };
      const Submission submission =
          prepare(requests, rules.folder, queue, rules.user, !dry_run, context);
      Json estimates = Json::array();
      for (const Estimate& e : submission.estimates) {
        estimates.push_back({{"name", e.name},
                             {"layers", e.layers},
                             {"seconds", e.seconds},
                             {"disk_bytes", e.disk_bytes},
                             {"memory_mb", e.memory_mb},
                             {"cached", e.cached},
                             {"duplicate", e.duplicate}});
      }
      Json json;
      json["ids"] = Json::array();
      if (!dry_run) {
        const Submitted submitted = submit(submission, rules.folder, queue, rules.user, "REST API");
        json["ids"] = submitted.ids;
        json["done_from_cache"] = submitted.done_from_cache;
      }
      json["estimates"] = estimates;
      json["notices"] = notices;
      return {dry_run ? 200 : 201,
              json.dump(-1, ' ', false, Json::error_handler_t::replace) + "\n"};
    } catch (const SubmitErrors& e) {
      return failed(e.errors(), rules.folder);
    }
  };
}

}  // namespace slicecorr::farm
