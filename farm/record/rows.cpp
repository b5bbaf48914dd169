// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "record/rows.hpp"

#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include "slicecorr/error.hpp"
#include "support/json/read_json.hpp"

namespace slicecorr::farm::detail {

using Json = nlohmann::json;

namespace {

/// What `read` makes of a list that we wrote; empty where nothing was.
template <class Read>
auto from_json(const Rows& row, int column, const Read& read) {
  const std::string text = row.text(column);
  using Result = decltype(read(Json()));
  if (text.empty()) return Result();
  try {
    return read(slicecorr::detail::own_json<Json>(text));
  } catch (const Json::exception&) {
    throw InputError(row.path(), "",
                     "is damaged: a list in it can't be read; expected the database of a farm");
  }
}

}  // namespace

const std::string kSelectJobs =
    "SELECT j.id, j.batch, j.state, j.reason, j.message, j.name, j.user, j.labels, j.priority, "
    "j.ready_by_ms, j.key, j.follows, j.parts, w.kind, w.printer, w.resin, w.format, "
    "j.output_folder, w.layers, w.voxels, j.expected_s, j.expected_bytes, j.attempts, "
    "j.not_before_ms, j.token, j.cancel_wanted, j.from_cache, j.submitted_ms, j.started_ms, "
    "j.ended_ms, j.files, r.layers, r.height_mean_um, r.height_p95_um, r.height_max_um, "
    "r.lost_features, r.merged_features, r.cure_through_voxels, r.undercure_voxels, "
    "r.target_voxels, t.contrast, t.contrast_bound, t.ver, t.turns, t.print_time_s, t.feasible, "
    "s.light_s, s.print_s, v.outcome, v.words FROM jobs j JOIN works w ON w.key = j.key "
    "LEFT JOIN results r ON r.key = j.key AND j.state = 'done' "
    "LEFT JOIN tomo_results t ON t.key = r.key LEFT JOIN stack_times s ON s.key = r.key "
    "LEFT JOIN stack_verdicts v ON v.key = r.key ";

std::optional<TomoFigures> read_tomo_figures(const Rows& r, int first) {
  if (r.null(first)) return std::nullopt;
  return TomoFigures{r.number(first),     r.number(first + 1),
                     r.number(first + 2), static_cast<int>(r.integer(first + 3)),
                     r.number(first + 4), r.integer(first + 5) != 0};
}

std::optional<StackTime> read_stack_time(const Rows& r, int first) {
  if (r.null(first)) return std::nullopt;
  StackTime time{r.number(first)};
  if (!r.null(first + 1)) time.print_s = r.number(first + 1);
  return time;
}

std::optional<ResultVerdict> read_verdict(const Rows& r, int first) {
  if (r.null(first)) return std::nullopt;
  return ResultVerdict{r.text(first), r.text(first + 1)};
}

Job read_job(const Rows& r) {
  Job j;
  int c = -1;
  j.id = r.integer(++c);
  j.batch = r.integer(++c);
  j.state = job_state_named(r.text(++c)).value_or(JobState::queued);
  j.reason = reason_named(r.text(++c));
  j.message = r.text(++c);
  j.name = r.text(++c);
  j.user = r.text(++c);
  j.labels = parse_list(r, ++c);
  j.priority = static_cast<int>(r.integer(++c));
  j.ready_by_ms = r.integer(++c);
  j.key = r.text(++c);
  j.follows = r.integer(++c);
  j.parts = parse_list(r, ++c);
  j.kind = r.text(++c);
  j.printer = r.text(++c);
  j.resin = r.text(++c);
  j.format = r.text(++c);
  j.output_folder = r.text(++c);
  j.layers = static_cast<int>(r.integer(++c));
  j.voxels = r.integer(++c);
  j.expected_s = r.number(++c);
  j.expected_bytes = r.integer(++c);
  j.attempts = static_cast<int>(r.integer(++c));
  j.not_before_ms = r.integer(++c);
  j.token = r.text(++c);
  j.cancel_wanted = r.integer(++c) != 0;
  j.from_cache = r.integer(++c) != 0;
  j.submitted_ms = r.integer(++c);
  j.started_ms = r.integer(++c);
  j.ended_ms = r.integer(++c);
  j.files = parse_files(r, ++c);
  if (!r.null(++c)) {
    ResultFigures f;
    f.layers = static_cast<int>(r.integer(c));
    f.height_mean_um = r.number(++c);
    f.height_p95_um = r.number(++c);
    f.height_max_um = r.number(++c);
    f.lost_features = r.integer(++c);
    f.merged_features = r.integer(++c);
    f.cure_through_voxels = r.integer(++c);
    f.undercure_voxels = r.integer(++c);
    f.target_voxels = r.integer(++c);
    f.tomo = read_tomo_figures(r, ++c);
    f.time = read_stack_time(r, c + kTomoColumns);
    f.verdict = read_verdict(r, c + kTomoColumns + kTimeColumns);
    j.figures = f;
  }
  return j;
}

const std::string kSelectAttempts =
    "SELECT a.token, a.job, a.number, a.engine, a.engine_id, a.service, a.node, a.threads, "
    "a.memory_mb, a.started_ms, a.ended_ms, a.phase, a.stage, a.fraction, a.layers_done, a.reason, "
    "a.message, a.exit_code, a.wall_s, a.cpu_s, a.peak_mb, a.log FROM attempts a ";

Attempt read_attempt(const Rows& r) {
  Attempt a;
  int c = -1;
  a.token = r.text(++c);
  a.job = r.integer(++c);
  a.number = static_cast<int>(r.integer(++c));
  a.engine = r.text(++c);
  a.engine_id = r.text(++c);
  a.service = r.text(++c);
  a.node = r.text(++c);
  a.threads = static_cast<int>(r.integer(++c));
  a.memory_mb = r.integer(++c);
  a.started_ms = r.integer(++c);
  a.ended_ms = r.integer(++c);
  a.phase = r.text(++c);
  a.stage = r.text(++c);
  a.fraction = r.number(++c);
  a.layers_done = static_cast<int>(r.integer(++c));
  a.reason = reason_named(r.text(++c));
  a.message = r.text(++c);
  a.exit_code = static_cast<int>(r.integer(++c));
  a.wall_s = r.number(++c);
  a.cpu_s = r.number(++c);
  a.peak_mb = r.integer(++c);
  a.log = r.text(++c);
  return a;
}

FarmSettings read_settings(Database& db) {
  FarmSettings settings;
  Rows rows = db.query("SELECT name, value FROM settings");
  while (rows.next()) {
    try {
      set_setting(settings, rows.text(0), rows.text(1));
    } catch (const InputError& e) {
      throw InputError(rows.path(), "settings", e.what());
    }
  }
  return settings;
}

std::string list_json(const std::vector<std::string>& list) {
  return Json(list).dump(-1, ' ', false, Json::error_handler_t::replace);
}

std::vector<std::string> parse_list(const Rows& row, int column) {
  return from_json(row, column,
                   [](const Json& json) { return json.get<std::vector<std::string>>(); });
}

std::string files_json(const std::vector<ResultFile>& files) {
  Json list = Json::array();
  for (const ResultFile& f : files) {
    list.push_back({{"ending", f.ending}, {"bytes", f.bytes}, {"sha256", f.sha256}});
  }
  return list.dump();
}

std::vector<ResultFile> parse_files(const Rows& row, int column) {
  return from_json(row, column, [](const Json& json) {
    std::vector<ResultFile> files;
    for (const Json& f : json) files.push_back({f.at("ending"), f.at("bytes"), f.at("sha256")});
    return files;
  });
}

}  // namespace slicecorr::farm::detail
