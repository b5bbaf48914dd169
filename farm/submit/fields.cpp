// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "submit/fields.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <functional>
#include <limits>
#include <set>
#include <string_view>

#include "programs/common/program.hpp"
#include "slicecorr/flow.hpp"
#include "support/text/ascii.hpp"
#include "support/text/nearest.hpp"

namespace slicecorr::farm::detail {

namespace fs = std::filesystem;

namespace {

constexpr double kMost = std::numeric_limits<double>::max();

/// How a value reads in a message.
std::string shown(const Value& v) {
  struct Show {
    std::string operator()(const std::string& s) const { return "'" + s + "'"; }
    std::string operator()(double d) const { return fmt::format("{}", d); }
    std::string operator()(bool b) const { return b ? "true" : "false"; }
    std::string operator()(const std::vector<std::string>&) const { return "a list"; }
    std::string operator()(const std::vector<double>&) const { return "a list"; }
  };
  return std::visit(Show{}, v.value);
}

std::string expected(const Value& v, const std::string& what) {
  return fmt::format("is {}, expected {}", shown(v), what);
}

std::optional<double> number_in(const Value& v) {
  if (const auto* d = std::get_if<double>(&v.value)) return *d;
  const auto* s = std::get_if<std::string>(&v.value);
  return s && v.from_text ? cli::number_of(*s) : std::nullopt;
}

/// A list of a text table is separated by semicolons.
std::vector<std::string> words_of(const Value& v) {
  if (const auto* list = std::get_if<std::vector<std::string>>(&v.value)) return *list;
  const auto* s = std::get_if<std::string>(&v.value);
  if (!s) return {};
  if (!v.from_text) return {*s};
  std::vector<std::string> words;
  for (std::size_t at = 0;;) {
    const std::size_t end = s->find(';', at);
    std::string word = s->substr(at, end - at);
    word.erase(0, word.find_first_not_of(' '));
    word.erase(word.find_last_not_of(' ') + 1);
    if (!word.empty()) words.push_back(word);
    if (end == s->npos) return words;
    at = end + 1;
  }
}

/// A member as a text of its own for each value.
std::string text_of_value(double v) { return fmt::format("{}", v); }
std::string text_of_value(int v) { return fmt::format("{}", v); }
std::string text_of_value(bool v) { return v ? "yes" : "no"; }
std::string text_of_value(const std::string& v) { return fmt::format("{}:{}", v.size(), v); }
template <typename T>
std::string text_of_value(const std::vector<T>& list) {
  std::string text = "[";
  for (const T& v : list) text += text_of_value(v) + ",";
  return text + "]";
}

using Set = std::function<std::string(JobRequest&, const Value&)>;

/// A field of jobs: how it is set, and what it is.
struct Field {
  template <typename Member>
  Field(Member member, Set setter)
      : set(std::move(setter)), show([member](JobRequest r) { return text_of_value(member(r)); }) {}
  Set set;
  std::function<std::string(JobRequest)> show;
};

template <typename Member>
Field number(Member member, double least, double largest, bool above = false) {
  return {member, [=](JobRequest& r, const Value& v) -> std::string {
            const auto d = number_in(v);
            if (!d || *d > largest || (above ? *d <= least : *d < least)) {
              return expected(
                  v, largest >= kMost
                         ? fmt::format("a number {} {}", above ? "above" : "of at least", least)
                         : fmt::format("a number from {} to {}", least, largest));
            }
            member(r) = *d;
            return {};
          }};
}

template <typename Member>
Field whole(Member member, int least, int largest) {
  return {member, [=](JobRequest& r, const Value& v) -> std::string {
            const auto d = number_in(v);
            if (!d || *d < least || *d > largest || *d != std::floor(*d)) {
              return expected(v, fmt::format("a whole number from {} to {}", least, largest));
            }
            member(r) = static_cast<int>(*d);
            return {};
          }};
}

template <typename Member>
Field text(Member member, const std::string& what) {
  return {member, [=](JobRequest& r, const Value& v) -> std::string {
            const auto* s = std::get_if<std::string>(&v.value);
            if (!s || s->empty()) return expected(v, what);
            member(r) = *s;
            return {};
          }};
}

template <typename Member>
Field word(Member member, const std::vector<std::string>& known) {
  return {member, [=](JobRequest& r, const Value& v) -> std::string {
            const auto* s = std::get_if<std::string>(&v.value);
            if (!s || std::find(known.begin(), known.end(), *s) == known.end()) {
              std::string list;
              for (const std::string& k : known) list += (list.empty() ? "" : ", ") + k;
              return expected(v, "one of " + list);
            }
            member(r) = *s;
            return {};
          }};
}

template <typename Member>
Field numbers(Member member, std::size_t count) {
  return {member, [=](JobRequest& r, const Value& v) -> std::string {
            std::vector<double> list;
            if (const auto* d = std::get_if<std::vector<double>>(&v.value)) {
              list = *d;
            } else {
              for (const std::string& w : words_of(v)) {
                const auto d = cli::number_of(w);
                if (!d) return expected(v, fmt::format("{} numbers", count));
                list.push_back(*d);
              }
            }
            if (list.size() != count) return expected(v, fmt::format("{} numbers", count));
            member(r) = list;
            return {};
          }};
}

template <typename Member>
Field texts(Member member, const std::string& what) {
  return {member, [=](JobRequest& r, const Value& v) -> std::string {
            std::vector<std::string> list = words_of(v);
            if (list.empty() || std::find(list.begin(), list.end(), "") != list.end()) {
              return expected(v, what);
            }
            member(r) = std::move(list);
            return {};
          }};
}

template <typename Member>
Field flag(Member member) {
  return {member, [=](JobRequest& r, const Value& v) -> std::string {
            const auto* b = std::get_if<bool>(&v.value);
            const auto* s = std::get_if<std::string>(&v.value);
            if (b) {
              member(r) = *b;
            } else if (v.from_text && s && (*s == "true" || *s == "false")) {
              member(r) = *s == "true";
            } else {
              return expected(v, "true or false");
            }
            return {};
          }};
}

std::string set_omega_max(JobRequest& r, const Value& v) {
  const auto d = number_in(v);
  const auto* s = std::get_if<std::string>(&v.value);
  if (s && *s == "inf") {
    r.setup.omega_max = "inf";
  } else if (d && *d >= 1) {
    r.setup.omega_max = fmt::format("{}", *d);
  } else {
    return expected(v, "inf, or a number of at least 1");
  }
  return {};
}

#define SLICEFARM_FIELD(path) ([](JobRequest & r) -> auto& { return r.path; })

const std::map<std::string, Field, std::less<>>& fields() {
  static const std::map<std::string, Field, std::less<>> table = {
      {"part", texts(SLICEFARM_FIELD(parts), "the path of a mesh, an archive or a volume")},
      {"parts", texts(SLICEFARM_FIELD(parts), "paths of meshes that share the plate")},
      {"printer", text(SLICEFARM_FIELD(setup.printer), "a name or a .toml file")},
      {"resin", text(SLICEFARM_FIELD(setup.resin), "a name or a .toml file")},
      {"layer_um", number(SLICEFARM_FIELD(layer_um), 1, 1000)},
      {"antialias", word(SLICEFARM_FIELD(antialias), {"on", "off"})},
      {"surface", word(SLICEFARM_FIELD(setup.surface), {"slices", "mesh"})},
      {"units", word(SLICEFARM_FIELD(units), {"auto", "mm", "inch", "m"})},
      {"scale", number(SLICEFARM_FIELD(scale), 0, kMost, true)},
      {"fit_mm", number(SLICEFARM_FIELD(fit_mm), 0, kMost, true)},
      {"center_mm", numbers(SLICEFARM_FIELD(center_mm), 2)},
      {"rotate_deg", numbers(SLICEFARM_FIELD(rotate_deg), 3)},
      {"mode", word(SLICEFARM_FIELD(setup.mode), {"continuous", "layerwise", kTomographyMode})},
      {"voxel_mm", number(SLICEFARM_FIELD(voxel_mm), 0, kMost, true)},
      {"method", word(SLICEFARM_FIELD(method), {"ladder", "osmo", "kelly", "fbp"})},
      {"window", word(SLICEFARM_FIELD(window), {"hamming", "ram-lak", "kelly"})},
      {"angles", whole(SLICEFARM_FIELD(angles), 3, 100000)},
      {"iterations", whole(SLICEFARM_FIELD(iterations), 1, 100000)},
      {"leave_alone", texts(SLICEFARM_FIELD(leave_alone), "paths of meshes or stacks")},
      {"insert", texts(SLICEFARM_FIELD(inserts), "paths of meshes or volumes")},
      {"clip_sigma", number(SLICEFARM_FIELD(clip_sigma), 0, kMost, true)},
      {"stop_error", number(SLICEFARM_FIELD(stop_error), 0, kMost, true)},
      {"max_time_s", number(SLICEFARM_FIELD(max_time_s), 0, kMost, true)},
      {"beyond_reach", flag(SLICEFARM_FIELD(beyond_reach))},
      {"plan", flag(SLICEFARM_FIELD(plan))},
      {"uncertain", text(SLICEFARM_FIELD(uncertain), "errors of inputs, as in ha=5%,dc=5%")},
      {"robust", flag(SLICEFARM_FIELD(robust))},
      {"tolerance_um", number(SLICEFARM_FIELD(tolerance_um), 0, kMost, true)},
      {"gap_contrast", number(SLICEFARM_FIELD(gap_contrast), 0, 1, true)},
      {"speed_mm_h", number(SLICEFARM_FIELD(setup.speed_mm_h), 0, kMost, true)},
      {"exposure_s", number(SLICEFARM_FIELD(setup.exposure_s), 0, kMost, true)},
      {"bottom_exposure_s", number(SLICEFARM_FIELD(setup.bottom_exposure_s), 0, kMost, true)},
      {"bottom_layers", whole(SLICEFARM_FIELD(setup.bottom_layers), 0, 1000000)},
      {"fade_layers", whole(SLICEFARM_FIELD(setup.fade_layers), 0, 1000000)},
      {"uv_mw_cm2", number(SLICEFARM_FIELD(setup.uv_mw_cm2), 0, kMost, true)},
      {"dead_zone_um", number(SLICEFARM_FIELD(setup.dead_zone_um), 0, kMost, true)},
      {"gap_um", number(SLICEFARM_FIELD(setup.gap_um), 0, kMostGapUm, true)},
      {"even_dead_zone",
       word(SLICEFARM_FIELD(setup.even_dead_zone), {"auto", "constant", "blue", "uv", "both"})},
      {"uv_schedule",
       word(SLICEFARM_FIELD(setup.uv_schedule), {"constant", "per-slice", "patterned"})},
      {"window_cure", word(SLICEFARM_FIELD(setup.window_cure), {"refuse", "allow"})},
      {"ramp", word(SLICEFARM_FIELD(setup.ramp), {"none", "lamp-follows", "outside"})},
      {"ramp_mm", number(SLICEFARM_FIELD(setup.ramp_mm), 0, kMost, true)},
      {"omega_max", {SLICEFARM_FIELD(setup.omega_max), set_omega_max}},
      {"one_slice_gaps", word(SLICEFARM_FIELD(setup.one_slice_gaps), {"open", "merge"})},
      {"gap_shortfall", number(SLICEFARM_FIELD(setup.gap_shortfall), 0, 0.5, true)},
      {"edge_aim_um", number(SLICEFARM_FIELD(setup.edge_aim_um), 0, kMostEdgeAimUm, true)},
      {"platform_features", word(SLICEFARM_FIELD(setup.platform_features), {"capped", "uncapped"})},
      {"dc_mj_cm3", number(SLICEFARM_FIELD(setup.dc_mj_cm3), 0, kMost, true)},
      {"dose_factor", number(SLICEFARM_FIELD(setup.dose_factor), 0, 1e3, true)},
      {"ha_um", number(SLICEFARM_FIELD(setup.ha_um), 0, kMost, true)},
      {"spread_correction", word(SLICEFARM_FIELD(setup.spread_correction), {"on", "off"})},
      {"rounds", whole(SLICEFARM_FIELD(setup.rounds), 0, Process::kMostSpreadRounds)},
      {"resin_depth_um", number(SLICEFARM_FIELD(setup.resin_depth_um), 0, kMostDepthUm, true)},
      {"platform_reflectance", number(SLICEFARM_FIELD(setup.platform_reflectance), 0, 1)},
      {"name", text(SLICEFARM_FIELD(name), "a file name without its ending")},
      {"format", text(SLICEFARM_FIELD(format), "a format of archives, or its ending")},
      {"out", text(SLICEFARM_FIELD(out), "a folder")},
      {"copies", whole(SLICEFARM_FIELD(copies), 1, 10000)},
      {"priority", whole(SLICEFARM_FIELD(priority), -1000000, 1000000)},
      {"ready_by", text(SLICEFARM_FIELD(ready_by), "HH:MM or YYYY-MM-DD HH:MM")},
      {"labels", texts(SLICEFARM_FIELD(labels), "words")},
      {"user", text(SLICEFARM_FIELD(user), "a name")},
  };
  return table;
}
#undef SLICEFARM_FIELD

/// Fields of every job, and of which tomographic prints have more.
const std::set<std::string, std::less<>> kOfAll{
    "part", "parts",  "printer",  "resin",    "layer_um", "mode", "name",
    "out",  "copies", "priority", "ready_by", "labels",   "user", "format"};
const std::set<std::string, std::less<>> kOfMeshes{"units", "scale", "fit_mm", "rotate_deg"};
const std::set<std::string, std::less<>> kOfTomography{
    "voxel_mm",   "method",       "window", "angles",     "iterations",
    "max_time_s", "beyond_reach", "insert", "clip_sigma", "stop_error"};

}  // namespace

JobKind kind_of(const JobRequest& r) {
  if (r.setup.mode != kTomographyMode) return JobKind::slices;
  return std::any_of(r.parts.begin(), r.parts.end(), is_volume) ? JobKind::tomographic_volume
                                                                : JobKind::tomographic_mesh;
}

std::string misfit(const std::string& key, const std::string& name, JobKind kind) {
  if (kOfAll.contains(key)) return {};
  if (kind == JobKind::slices) {
    if (!kOfTomography.contains(key)) return {};
    return fmt::format("{} is for tomographic prints; expected mode {} with it", name,
                       kTomographyMode);
  }
  if (kOfTomography.contains(key)) return {};
  if (!kOfMeshes.contains(key)) {
    return fmt::format("{} has no place in a tomographic print", name);
  }
  if (kind == JobKind::tomographic_mesh) return {};
  return fmt::format("{} has no place with a volume: its voxels stay where they are", name);
}

void make_defaults(JobRequest& request) {
  for (auto& [key, said] : request.said) said.default_ = true;
}

std::string set_field(JobRequest& request, const std::string& key, const Value& value) {
  const auto found = fields().find(key);
  if (found == fields().end()) {
    std::vector<std::string> names = field_names();
    std::vector<std::string_view> views(names.begin(), names.end());
    const std::string near = nearest(key, views);
    return "'" + key + "' is not known" + (near.empty() ? "" : "; expected " + near + "?");
  }
  const std::string error = found->second.set(request, value);
  request.said[key] = {value.where, false};
  return error.empty() ? "" : key + " " + error;
}

std::string work_text(const JobRequest& request) {
  /// What a job is called and when it is done, not what is made.
  static const std::set<std::string, std::less<>> beside{"name",     "out",    "copies", "priority",
                                                         "ready_by", "labels", "user",   "format"};
  std::string text;
  for (const auto& [key, field] : fields()) {
    if (!beside.contains(key)) text += key + "=" + field.show(request) + "\n";
  }
  return text;
}

std::vector<std::string> field_names() {
  std::vector<std::string> names;
  for (const auto& [name, set] : fields()) names.push_back(name);
  return names;
}

void make_paths_absolute(JobRequest& r, const std::string& folder) {
  const auto absolute = [&](std::string& path) {
    if (!path.empty()) path = (fs::absolute(folder) / path).lexically_normal().string();
  };
  for (std::string& p : r.parts) absolute(p);
  for (std::string& p : r.leave_alone) absolute(p);
  for (std::string& p : r.inserts) absolute(p);
  absolute(r.out);
  while (r.out.size() > 1 && r.out.back() == '/') r.out.pop_back();
  // Other definitions are names of the database.
  for (std::string* definition : {&r.setup.printer, &r.setup.resin}) {
    if (definition->ends_with(".toml")) absolute(*definition);
  }
}

bool is_volume(const std::string& path) {
  return lower_case(fs::path(path).extension().string()) == ".npy";
}

std::string stem_of(const std::string& path) {
  fs::path name = fs::path(path).filename();
  const std::string ending = lower_case(name.extension().string());
  name = name.stem();
  if (ending == ".gz") name = name.stem();
  if (lower_case(name.extension().string()) == ".rgb") name = name.stem();
  return name.string();
}

}  // namespace slicecorr::farm::detail

namespace slicecorr::farm {

void absolute_paths(JobRequest& request) {
  detail::make_paths_absolute(request, std::filesystem::current_path().string());
}

}  // namespace slicecorr::farm
