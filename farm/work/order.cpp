// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// What service and worker write for each other, as JSON in the attempt's folder.

#include <fmt/format.h>

#include <cmath>
#include <cstdio>
#include <limits>
#include <nlohmann/json.hpp>

#include "programs/common/program.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/farm/store.hpp"
#include "slicecorr/farm/work.hpp"
#include "slicecorr/version.hpp"
#include "support/files/text_file.hpp"
#include "support/json/finite.hpp"
#include "support/json/read_json.hpp"
#include "work/files.hpp"

namespace slicecorr::farm {

using Json = nlohmann::ordered_json;

namespace {

/// Changes when the same spec gives other bytes though the program's version is the same.
constexpr int kKeyFormat = 2;

/// What parts have of their own.
constexpr std::pair<const char*, std::vector<double> PlateChoices::*> kOwn[] = {
    {"own_fit_mm", &PlateChoices::own_fit_mm},
    {"own_scale", &PlateChoices::own_scale},
    {"own_rotate_deg", &PlateChoices::own_rotate_deg},
};

Json json_of(const WorkSpec& s, bool with_names) {
  Json json;
  json["kind"] = s.kind;
  json["inputs"] = Json::array();
  for (const WorkSpec::Input& i : s.inputs) {
    Json input = {{"file", i.file}, {"sha256", i.sha256}};
    if (with_names) input["name"] = i.name;
    json["inputs"].push_back(std::move(input));
  }
  if (s.left_alone > 0) json["left_alone"] = s.left_alone;
  if (s.inside > 0) json["inside"] = s.inside;
  json["layer_um"] = s.layer_um;
  json["antialias"] = s.antialias;
  json["units"] = s.units;
  json["scale"] = s.scale;
  json["center_mm"] = s.center_mm;
  json["rotate_deg"] = s.rotate_deg;
  // Keys of parts that lie as in their files stay.
  if (s.plate != PlateChoices{}) {
    json["plate"] = {{"overlap", s.plate.overlap},
                     {"arrange", s.plate.arrange},
                     {"spacing_mm", s.plate.spacing_mm},
                     {"turn_about_z", s.plate.turn_about_z}};
    if (!s.plate.places_mm.empty()) {
      json["plate"]["places_mm"] = s.plate.places_mm;
      json["plate"]["quarter_turns"] = s.plate.quarter_turns;
    }
    for (const auto& [key, member] : kOwn) {
      if (!(s.plate.*member).empty()) json["plate"][key] = s.plate.*member;
    }
  }
  json["format"] = s.format;
  json["ending"] = s.ending;
  json["name"] = s.name;
  if (!s.uncertain.empty()) {
    json["uncertain"] = {
        {"text", s.uncertain}, {"resin_toml", s.uncertain_resin_toml}, {"robust", s.robust}};
  }
  if (!s.warnings.empty()) json["warnings"] = s.warnings;
  if (s.tomo) {
    const TomoWork& t = *s.tomo;
    json["tomo"] = {{"volume", t.volume},
                    {"inserts", t.inserts},
                    {"voxel_mm", t.voxel_mm},
                    {"method", t.method},
                    {"window", t.window},
                    {"angles", t.angles},
                    {"iterations", t.iterations},
                    {"clip_sigma", t.clip_sigma},
                    {"stop_error", t.stop_error},
                    {"max_time_s", t.max_time_s},
                    {"beyond_reach", t.beyond_reach}};
  }
  return json;
}

WorkSpec spec_of(const Json& json) {
  WorkSpec s;
  s.kind = json.at("kind");
  for (const Json& i : json.at("inputs")) {
    s.inputs.push_back({i.at("file"), i.at("sha256"), i.value("name", "")});
  }
  s.left_alone = json.value("left_alone", 0);
  s.inside = json.value("inside", 0);
  s.layer_um = json.at("layer_um");
  s.antialias = json.at("antialias");
  s.units = json.at("units");
  s.scale = json.at("scale");
  s.center_mm = json.at("center_mm").get<std::vector<double>>();
  s.rotate_deg = json.at("rotate_deg").get<std::vector<double>>();
  if (json.contains("plate")) {
    const Json& plate = json["plate"];
    s.plate.overlap = plate.at("overlap");
    s.plate.arrange = plate.at("arrange");
    s.plate.spacing_mm = plate.at("spacing_mm");
    s.plate.turn_about_z = plate.at("turn_about_z");
    s.plate.places_mm = plate.value("places_mm", std::vector<double>());
    s.plate.quarter_turns = plate.value("quarter_turns", std::vector<double>());
    for (const auto& [key, member] : kOwn) {
      s.plate.*member = plate.value(key, std::vector<double>());
    }
  }
  s.format = json.at("format");
  s.ending = json.at("ending");
  s.name = json.at("name");
  if (json.contains("uncertain")) {
    const Json& u = json.at("uncertain");
    s.uncertain = u.at("text");
    s.uncertain_resin_toml = u.at("resin_toml");
    s.robust = u.at("robust");
  }
  s.warnings = json.value("warnings", std::vector<std::string>());
  if (json.contains("tomo")) {
    const Json& t = json.at("tomo");
    s.tomo =
        TomoWork{t.at("volume"),     t.at("inserts"),    t.at("voxel_mm"),    t.at("method"),
                 t.at("window"),     t.at("angles"),     t.at("iterations"),  t.at("clip_sigma"),
                 t.at("stop_error"), t.at("max_time_s"), t.at("beyond_reach")};
  }
  return s;
}

double finite_of(const Json& json) {
  return json.is_null() ? std::numeric_limits<double>::infinity() : json.get<double>();
}

Json tomo_json(const TomoFigures& t) {
  return {{"contrast", slicecorr::detail::finite_or_null<Json>(t.contrast)},
          {"contrast_bound", slicecorr::detail::finite_or_null<Json>(t.contrast_bound)},
          {"ver", t.ver},
          {"turns", t.turns},
          {"print_time_s", t.print_time_s},
          {"feasible", t.feasible}};
}

TomoFigures tomo_of(const Json& json) {
  return {finite_of(json.at("contrast")),
          finite_of(json.at("contrast_bound")),
          json.at("ver"),
          json.at("turns"),
          json.at("print_time_s"),
          json.at("feasible")};
}

std::string dump(const Json& json) {
  return json.dump(1, ' ', false, Json::error_handler_t::replace) + "\n";
}

/// By rename, so that who reads it reads all of it.
void replace_file(const std::string& path, const std::string& text) {
  cli::write_text_file(path, text);
}

}  // namespace

std::string spec_json(const WorkSpec& spec) { return json_of(spec, true).dump(); }

WorkSpec parse_spec(const std::string& json) {
  try {
    return spec_of(slicecorr::detail::read_json<Json>(json, {"what a job has to do", ""}));
  } catch (const Json::exception& e) {
    throw InputError(
        fmt::format("what a job has to do can't be read: {}", slicecorr::detail::in_words(e)));
  }
}

std::string work_key(const WorkSpec& spec, const std::string& setup_json) {
  return sha256_of_text(fmt::format("slicefarm {}\nslicecorr {}\n{}\n{}", kKeyFormat, version,
                                    json_of(spec, false).dump(), setup_json));
}

void write_order(const std::string& folder, const WorkOrder& o) {
  Json json;
  json["format"] = o.spec.tomo ? detail::kTomoOrderFormat : detail::kOrderFormat;
  json["token"] = o.token;
  json["job"] = o.job;
  json["number"] = o.number;
  json["key"] = o.key;
  json["name"] = o.name;
  json["spec"] = json_of(o.spec, true);
  json["setup"] = o.setup_json;
  json["store"] = o.store;
  json["threads"] = o.threads;
  json["memory_mb"] = o.memory_mb;
  replace_file(folder + "/order.json", dump(json));
}

WorkOrder read_order(const std::string& folder) {
  const std::string path = folder + "/order.json";
  const auto text = text_of_file(path);
  if (!text) throw InputError(path, "", "can't be read; expected the order of an attempt");
  try {
    const Json json = slicecorr::detail::read_json<Json>(*text, {path, ""});
    const int format = json.at("format");
    if (format != detail::kOrderFormat && format != detail::kTomoOrderFormat) {
      throw InputError(path, "",
                       fmt::format("has format {}; this program knows {} and {}", format,
                                   detail::kOrderFormat, detail::kTomoOrderFormat));
    }
    WorkOrder o;
    o.token = json.at("token");
    o.job = json.at("job");
    o.number = json.at("number");
    o.key = json.at("key");
    o.name = json.at("name");
    o.spec = spec_of(json.at("spec"));
    o.setup_json = json.at("setup");
    o.store = json.at("store");
    o.threads = json.at("threads");
    o.memory_mb = json.at("memory_mb");
    return o;
  } catch (const Json::exception& e) {
    throw InputError(path, "", slicecorr::detail::in_words(e));
  }
}

void detail::write_progress(const std::string& folder, const ProgressNote& p) {
  const Json json = {{"stage", p.stage},
                     {"node", p.node},
                     {"fraction", p.fraction},
                     {"layers_done", p.layers_done},
                     {"beat", p.beat}};
  replace_file(folder + "/progress.json", json.dump());
}

std::optional<ProgressNote> read_progress(const std::string& folder) {
  const auto text = text_of_file(folder + "/progress.json");
  if (!text) return std::nullopt;
  try {
    const Json json = slicecorr::detail::try_json<Json>(*text);
    return ProgressNote{json.at("stage"), json.at("node"), json.at("fraction"),
                        json.at("layers_done"), json.at("beat")};
  } catch (const Json::exception&) {
    return std::nullopt;
  }
}

void detail::write_outcome(const std::string& folder, const WorkOutcome& o) {
  Json json;
  json["format"] = detail::kOrderFormat;
  json["token"] = o.token;
  json["key"] = o.key;
  json["exit_code"] = o.exit_code;
  json["reason"] = name_of(o.reason);
  json["message"] = o.message;
  json["node"] = o.node;
  json["program"] = o.program;
  const ResultFigures& f = o.figures;
  json["figures"] = {{"layers", f.layers},
                     {"height_mean_um", f.height_mean_um},
                     {"height_p95_um", f.height_p95_um},
                     {"height_max_um", f.height_max_um},
                     {"lost_features", f.lost_features},
                     {"merged_features", f.merged_features},
                     {"cure_through_voxels", f.cure_through_voxels},
                     {"undercure_voxels", f.undercure_voxels},
                     {"target_voxels", f.target_voxels}};
  if (f.tomo) json["figures"]["tomo"] = tomo_json(*f.tomo);
  if (f.time) {
    json["figures"]["time"] = {{"light_s", f.time->light_s},
                               {"print_s", f.time->print_s ? Json(*f.time->print_s) : Json()}};
  }
  if (f.verdict) {
    json["figures"]["verdict"] = {{"outcome", f.verdict->outcome}, {"words", f.verdict->words}};
  }
  json["files"] = Json::array();
  for (const ResultFile& r : o.files) {
    json["files"].push_back({{"ending", r.ending}, {"bytes", r.bytes}, {"sha256", r.sha256}});
  }
  json["voxels"] = o.voxels;
  json["wall_s"] = o.wall_s;
  json["cpu_s"] = o.cpu_s;
  json["peak_mb"] = o.peak_mb;
  replace_file(folder + "/result.json", dump(json));
}

std::optional<WorkOutcome> read_outcome(const std::string& folder) {
  const auto text = text_of_file(folder + "/result.json");
  if (!text) return std::nullopt;
  try {
    const Json json = slicecorr::detail::try_json<Json>(*text);
    WorkOutcome o;
    o.token = json.at("token");
    o.key = json.at("key");
    o.exit_code = json.at("exit_code");
    o.reason = reason_named(json.at("reason").get<std::string>());
    o.message = json.at("message");
    o.node = json.at("node");
    o.program = json.at("program");
    const Json& f = json.at("figures");
    o.figures = {f.at("layers"),
                 f.at("height_mean_um"),
                 f.at("height_p95_um"),
                 f.at("height_max_um"),
                 f.at("lost_features"),
                 f.at("merged_features"),
                 f.at("cure_through_voxels"),
                 f.at("undercure_voxels"),
                 f.at("target_voxels")};
    if (f.contains("tomo")) o.figures.tomo = tomo_of(f.at("tomo"));
    if (f.contains("time")) {
      const Json& time = f.at("time");
      o.figures.time.emplace().light_s = time.at("light_s");
      if (!time.at("print_s").is_null()) o.figures.time->print_s = time.at("print_s").get<double>();
    }
    if (f.contains("verdict")) {
      const Json& verdict = f.at("verdict");
      o.figures.verdict = {verdict.at("outcome"), verdict.at("words")};
    }
    for (const Json& r : json.at("files")) {
      o.files.push_back({r.at("ending"), r.at("bytes"), r.at("sha256")});
    }
    o.voxels = json.at("voxels");
    o.wall_s = json.at("wall_s");
    o.cpu_s = json.at("cpu_s");
    o.peak_mb = json.at("peak_mb");
    return o;
  } catch (const Json::exception&) {
    return std::nullopt;
  }
}

}  // namespace slicecorr::farm
