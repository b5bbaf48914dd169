// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// What `status --json`, the REST API and others give of jobs, attempts, events and the farm.

#include <cmath>
#include <nlohmann/json.hpp>

#include "slicecorr/farm/read_model.hpp"
#include "support/json/finite.hpp"

namespace slicecorr::farm {

using Json = nlohmann::ordered_json;

namespace {

std::string dump(const Json& json) {
  return json.dump(-1, ' ', false, Json::error_handler_t::replace);
}

Json time_or_null(std::int64_t ms) { return ms > 0 ? Json(ms) : Json(nullptr); }

using slicecorr::detail::finite_or_null;

Json files(const std::vector<ResultFile>& list) {
  Json json = Json::array();
  for (const ResultFile& f : list) {
    json.push_back({{"ending", f.ending}, {"bytes", f.bytes}, {"sha256", f.sha256}});
  }
  return json;
}

}  // namespace

std::string job_json(const Job& j) {
  Json json;
  json["id"] = j.id;
  json["batch"] = j.batch;
  json["name"] = j.name;
  json["state"] = name_of(j.state);
  json["reason"] = name_of(j.reason);
  json["message"] = j.message;
  json["user"] = j.user;
  json["labels"] = j.labels;
  json["priority"] = j.priority;
  json["ready_by_ms"] = j.ready_by_ms == kNoDeadline ? Json(nullptr) : Json(j.ready_by_ms);
  json["kind"] = j.kind;
  json["parts"] = j.parts;
  json["printer"] = j.printer;
  json["resin"] = j.resin;
  json["format"] = j.format;
  json["output_folder"] = j.output_folder;
  json["key"] = j.key;
  json["follows"] = j.follows > 0 ? Json(j.follows) : Json(nullptr);
  json["layers"] = j.layers;
  json["voxels"] = j.voxels;
  json["expected_s"] = j.expected_s;
  json["expected_bytes"] = j.expected_bytes;
  json["attempts"] = j.attempts;
  json["not_before_ms"] = time_or_null(j.not_before_ms);
  json["cancel_wanted"] = j.cancel_wanted;
  json["from_cache"] = j.from_cache;
  json["submitted_ms"] = j.submitted_ms;
  json["started_ms"] = time_or_null(j.started_ms);
  json["ended_ms"] = time_or_null(j.ended_ms);
  if (j.figures) {
    const ResultFigures& f = *j.figures;
    if (f.tomo) {
      json["figures"] = {{"layers", f.layers},
                         {"contrast", finite_or_null(f.tomo->contrast)},
                         {"contrast_bound", finite_or_null(f.tomo->contrast_bound)},
                         {"ver", f.tomo->ver},
                         {"turns", f.tomo->turns},
                         {"print_time_s", f.tomo->print_time_s},
                         {"feasible", f.tomo->feasible}};
    } else {
      json["figures"] = {{"layers", f.layers},
                         {"height_error_um",
                          {{"mean_abs", f.height_mean_um},
                           {"p95_abs", f.height_p95_um},
                           {"max_abs", f.height_max_um}}},
                         {"lost_features", f.lost_features},
                         {"merged_features", f.merged_features},
                         {"cure_through_voxels", f.cure_through_voxels},
                         {"undercure_voxels", f.undercure_voxels},
                         {"target_voxels", f.target_voxels}};
      if (f.time) {
        json["figures"]["light_s"] = f.time->light_s;
        json["figures"]["print_time_s"] = f.time->print_s ? Json(*f.time->print_s) : Json();
      }
      if (f.verdict) {
        json["figures"]["verdict"] = {{"outcome", f.verdict->outcome}, {"words", f.verdict->words}};
      }
    }
  }
  json["files"] = files(j.files);
  return dump(json);
}

std::string attempt_json(const Attempt& a) {
  Json json;
  json["token"] = a.token;
  json["job"] = a.job;
  json["number"] = a.number;
  json["engine"] = a.engine;
  json["engine_id"] = a.engine_id;
  json["node"] = a.node;
  json["threads"] = a.threads;
  json["memory_mb"] = a.memory_mb;
  json["phase"] = a.phase;
  json["stage"] = a.stage;
  json["fraction"] = a.fraction;
  json["layers_done"] = a.layers_done;
  json["started_ms"] = a.started_ms;
  json["ended_ms"] = time_or_null(a.ended_ms);
  json["reason"] = name_of(a.reason);
  json["message"] = a.message;
  json["exit_code"] = a.exit_code >= 0 ? Json(a.exit_code) : Json(nullptr);
  json["wall_s"] = a.wall_s;
  json["cpu_s"] = a.cpu_s;
  json["peak_mb"] = a.peak_mb;
  json["log"] = a.log;
  return dump(json);
}

std::string scan_json(const KeptScan& s) {
  const Json json = {{"job", s.job},
                     {"number", s.number},
                     {"name", s.name},
                     {"printer", s.printer},
                     {"resin", s.resin},
                     {"file", s.file},
                     {"bytes", s.bytes},
                     {"user", s.user},
                     {"at_ms", s.at_ms},
                     {"unit", s.unit},
                     {"voxel_um", s.voxel_um},
                     {"points", s.points},
                     {"with_design", s.with_design},
                     {"mean_um", s.mean_um},
                     {"mean_abs_um", s.mean_abs_um},
                     {"p95_abs_um", s.p95_um},
                     {"max_abs_um", s.worst_um},
                     {"unseen_share", s.unseen_share},
                     {"words", in_words(s)}};
  return dump(json);
}

std::string event_json(const FarmEvent& e) {
  Json json;
  json["seq"] = e.seq;
  json["at_ms"] = e.at_ms;
  json["job"] = e.job > 0 ? Json(e.job) : Json(nullptr);
  json["name"] = e.name;
  json["attempt"] = e.attempt;
  json["kind"] = e.kind;
  json["reason"] = name_of(e.reason);
  json["text"] = e.text;
  return dump(json);
}

std::string summary_json(const Summary& s, const FarmSettings& settings,
                         const std::vector<Service>& services) {
  Json json;
  for (int i = 0; i < kJobStates; ++i) {
    json["jobs"][name_of(static_cast<JobState>(i))] = s.jobs[static_cast<std::size_t>(i)];
  }
  json["followers"] = s.followers;
  json["from_cache"] = s.from_cache;
  json["attempts"] = s.attempts;
  json["attempts_failed"] = s.attempts_failed;
  json["queued_s"] = s.queued_s;
  json["eta_s"] = s.eta_s >= 0 ? Json(s.eta_s) : Json(nullptr);
  json["late"] = s.late;
  json["running_threads"] = s.running_threads;
  json["running_memory_mb"] = s.running_memory_mb;
  json["voxels_done"] = s.voxels_done;
  json["busy_s"] = s.busy_s;
  json["cache"] = {{"entries", s.cache_entries}, {"bytes", s.cache_bytes}};
  json["first_submitted_ms"] = time_or_null(s.first_submitted_ms);
  json["last_ended_ms"] = time_or_null(s.last_ended_ms);
  json["last_event"] = s.last_event;
  json["settings"] = setting_texts(settings);
  json["services"] = Json::array();
  for (const Service& v : services) {
    if (!v.alive) continue;
    json["services"].push_back({{"id", v.id},
                                {"engine", v.engine},
                                {"host", v.host},
                                {"pid", v.pid},
                                {"started_ms", v.started_ms},
                                {"seen_ms", v.seen_ms},
                                {"doing", v.doing},
                                {"cores", v.cores},
                                {"memory_mb", v.memory_mb}});
  }
  return dump(json);
}

}  // namespace slicecorr::farm
