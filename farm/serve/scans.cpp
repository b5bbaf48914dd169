// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Scans of prints over HTTP: what is kept of a job, a new one, the next print, prints over time.

#include "slicecorr/farm/scans.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "serve/api.hpp"
#include "serve/uploads.hpp"
#include "slicecorr/error.hpp"
#include "support/json/read_json.hpp"

namespace slicecorr::farm::detail {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

namespace {

/// A job whose print may be scanned.
void check_printed(const Job& job) {
  if (job.state != JobState::done) {
    throw ApiError(409, "state",
                   fmt::format("the job is {}, expected one that is done", name_of(job.state)));
  }
  if (job.kind == "tomo") {
    throw ApiError(409, "kind", "the job prints tomographically, of which no surface is predicted");
  }
}

/// One program of ours, which itself runs what it needs; its last word is the study's message.
StudyPlan one_step(const char* kind, const std::string& what,
                   const std::vector<std::string>& arguments) {
  StudyPlan plan;
  plan.kind = kind;
  plan.steps = {{what, [arguments](const std::string&) { return arguments; }}};
  plan.files = {fmt::format("{}.json", kind)};
  return plan;
}

}  // namespace

void Api::list_scans(JobId id, httplib::Response& response) {
  Reader reader(*this);
  Json list = Json::array();
  for (const KeptScan& s : reader->scans(id)) {
    list.push_back(slicecorr::detail::own_json<Json>(scan_json(s)));
  }
  send_json(response, 200, {{"job", id}, {"scans", list}});
}

void Api::scan_file(JobId id, const std::string& number, const std::string& what,
                    httplib::Response& response) {
  Reader reader(*this);
  const std::vector<KeptScan> scans = reader->scans(id);
  const auto found = std::find_if(scans.begin(), scans.end(),
                                  [&](const KeptScan& s) { return s.number == id_of(number); });
  if (found == scans.end()) throw ApiError(404, "not_found", "the job has no such scan");
  const std::string at = folder_.scan(found->folder);
  if (what == "scan") {
    response.set_header("Content-Security-Policy", kBarePolicy);
    return send_file(at + "/file/" + found->file, found->bytes, "application/octet-stream",
                     found->file, response);
  }
  if (what != "html" && what != "json") {
    throw ApiError(404, "not_found", "expected html, json or scan");
  }
  const bool page = what == "html";
  response.set_header("Content-Security-Policy", page ? kPartPolicy : kBarePolicy);
  send_file(at + "/comparison." + what, -1, page ? kHtmlType : kJsonType, "", response);
}

void Api::prints_wander(const std::string& what, Query& query, httplib::Response& response) {
  const std::string printer = query.text("printer"), resin = query.text("resin");
  query.end();
  Reader reader(*this);
  const std::vector<PrintsOverTime> all = prints_over_time(*reader);
  if (what == "drift") {
    if (!printer.empty() || !resin.empty()) {
      throw ApiError(400, "query", "a parameter that this request does not have");
    }
    return send(response, 200, prints_over_time_json(all), kJsonType);
  }
  const auto found = std::find_if(all.begin(), all.end(), [&](const PrintsOverTime& p) {
    return p.printer == printer && p.resin == resin;
  });
  if (found == all.end() || !found->drift) {
    throw ApiError(404, "not_found",
                   "fewer than three prints of this printer and resin were scanned");
  }
  if (what == "drift.svg") return send(response, 200, found->drift->to_svg(), "image/svg+xml");
  response.set_header("Content-Security-Policy", kPartPolicy);
  send(response, 200, found->drift->to_page(), kHtmlType);
}

void Api::new_scan(const Job& job, const std::string& text, const Asker& asker,
                   httplib::Response& response) {
  const Json json = parsed(text);
  check_keys(json, {"scan", "unit", "voxel_um"});
  const auto scan = json.find("scan");
  const std::string path = scan != json.end() && scan->is_string()
                               ? upload_path(folder_, scan->get<std::string>())
                               : std::string();
  std::error_code error;
  if (path.empty() || !fs::is_regular_file(path, error)) {
    throw ApiError(400, "json", "scan: expected an upload (\"upload:...\") that is still there");
  }
  check_printed(job);
  std::vector<std::string> arguments = {"slicefarm",
                                        "scan",
                                        std::to_string(job.id),
                                        path,
                                        "--dir",
                                        folder_.root,
                                        "--user",
                                        asker.name.empty() ? "api" : asker.name,
                                        "--json",
                                        "scan.json"};
  if (const auto unit = json.find("unit"); unit != json.end()) {
    constexpr std::string_view units[] = {"auto", "um", "mm", "cm", "inch", "m"};
    if (!unit->is_string() || std::find(std::begin(units), std::end(units),
                                        unit->get<std::string>()) == std::end(units)) {
      throw ApiError(400, "json", "unit: expected auto, um, mm, cm, inch or m");
    }
    arguments.push_back("--unit=" + unit->get<std::string>());
  }
  if (const auto voxel = json.find("voxel_um"); voxel != json.end()) {
    if (!voxel->is_number() || !(voxel->get<double>() > 0) || !(voxel->get<double>() <= 1e6)) {
      throw ApiError(400, "json", "voxel_um: expected a number above 0");
    }
    arguments.push_back(fmt::format("--voxel-um={}", voxel->get<double>()));
  }
  const std::string token =
      studies_.start(one_step("scan", "measuring the scan", arguments), asker.name);
  send_json(response, 202, studies_.state(token));
}

void Api::remove_scan(const Job& job, const std::string& number, const std::string& by,
                      httplib::Response& response) {
  Reader reader(*this);
  const auto n = static_cast<int>(std::min<std::int64_t>(id_of(number), 1'000'000));
  for (const KeptScan& s : reader->scans(job.id)) {
    if (s.number != n) continue;
    Queue queue(folder_.database(), *options_.clock);
    farm::remove_scan(folder_, queue, s, by);
    return send_json(response, 200, {{"job", job.id}, {"number", n}, {"removed", true}});
  }
  throw ApiError(404, "not_found", "the job has no such scan");
}

void Api::next_print(const Job& job, const std::string& text, const Asker& asker,
                     httplib::Response& response) {
  const Json json = text.empty() ? Json::object() : parsed(text);
  check_keys(json, {"scans"});
  if (!options_.submit) throw ApiError(403, "read_only", "this server takes no jobs");
  check_printed(job);
  std::string numbers;
  if (const auto scans = json.find("scans"); scans != json.end()) {
    if (!scans->is_array() || scans->empty() || scans->size() > kMostScansOfJob) {
      throw ApiError(400, "json", "scans: expected a list of numbers of scans");
    }
    for (const Json& n : *scans) {
      if (!n.is_number_integer() || n.get<std::int64_t>() < 1 ||
          n.get<std::int64_t>() > 1'000'000) {
        throw ApiError(400, "json", "scans: expected a list of numbers of scans");
      }
      numbers += (numbers.empty() ? "" : ",") + std::to_string(n.get<std::int64_t>());
    }
  }
  {
    Reader reader(*this);
    if (reader->scans(job.id).empty()) {
      throw ApiError(409, "state", "the job has no scan; expected one of its print");
    }
  }
  std::vector<std::string> arguments = {"slicefarm", "next",       std::to_string(job.id),
                                        "--dir",     folder_.root, "--user",
                                        job.user,    "--json",     "next.json"};
  if (!numbers.empty()) arguments.push_back("--scan=" + numbers);
  StudyPlan plan = one_step("next", "tuning by the scans", arguments);
  plan.name = tuned_name(job.resin, job.id);
  plan.files.push_back(plan.name + ".toml");
  plan.files.push_back(tuned_name(job.printer, job.id) + ".toml");
  const std::string token = studies_.start(std::move(plan), asker.name);
  send_json(response, 202, studies_.state(token));
}

}  // namespace slicecorr::farm::detail
