// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "submit/fields.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <functional>
#include <limits>
#include <nlohmann/json.hpp>
#include <set>
#include <string_view>

#include "programs/common/mesh_options.hpp"
#include "programs/common/program.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/settings.hpp"
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

/// The numbers of a value; nothing where it has others.
std::optional<std::vector<double>> numbers_in(const Value& v) {
  if (const auto* d = std::get_if<std::vector<double>>(&v.value)) return *d;
  if (const auto d = number_in(v)) return std::vector<double>{*d};
  std::vector<double> list;
  for (const std::string& w : words_of(v)) {
    const auto d = cli::number_of(w);
    if (!d) return std::nullopt;
    list.push_back(*d);
  }
  return list;
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

using Schema = nlohmann::ordered_json;

/// A field of jobs: how it is set, what it is, and how the API describes it.
struct Field {
  template <typename Member>
  Field(Member member, Schema described, Set setter)
      : set(std::move(setter)),
        show([member](JobRequest r) { return text_of_value(member(r)); }),
        unset([member](JobRequest& r) {
          JobRequest fresh;
          member(r) = member(fresh);
        }),
        schema(std::move(described)) {}
  /// With what it is for people.
  Field&& of(const std::string& words) && {
    schema["description"] = words;
    return std::move(*this);
  }
  /// Under a heading of forms.
  Field&& in(std::string_view group) && {
    schema["x-group"] = group;
    return std::move(*this);
  }
  Set set;
  std::function<std::string(JobRequest)> show;
  std::function<void(JobRequest&)> unset;
  Schema schema;
};
/// The heading of what a job makes, beside those of settings.
constexpr std::string_view kMade = "What is made";

Schema number_schema(const SettingRange& r) {
  Schema schema{{"type", r.whole ? "integer" : "number"}};
  if (r.above) {
    // As OpenAPI 3.0 has it.
    schema["minimum"] = r.least;
    schema["exclusiveMinimum"] = true;
  } else {
    schema["minimum"] = r.least;
  }
  if (r.most < kMost) schema["maximum"] = r.most;
  return schema;
}

template <typename Member>
Field number(Member member, double least, double largest, bool above = false) {
  return {member, number_schema({least, largest, above}),
          [=](JobRequest& r, const Value& v) -> std::string {
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
  return {member, number_schema({1.0 * least, 1.0 * largest, false, true}),
          [=](JobRequest& r, const Value& v) -> std::string {
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
  return {member, {{"type", "string"}}, [=](JobRequest& r, const Value& v) -> std::string {
            const auto* s = std::get_if<std::string>(&v.value);
            if (!s || s->empty()) return expected(v, what);
            member(r) = *s;
            return {};
          }};
}

template <typename Member>
Field word(Member member, const std::vector<std::string>& known) {
  return {member,
          {{"type", "string"}, {"enum", known}},
          [=](JobRequest& r, const Value& v) -> std::string {
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
  return {member,
          {{"type", "array"},
           {"items", {{"type", "number"}}},
           {"minItems", count},
           {"maxItems", count}},
          [=](JobRequest& r, const Value& v) -> std::string {
            const auto list = numbers_in(v);
            if (!list || list->size() != count) {
              return expected(v, fmt::format("{} numbers", count));
            }
            member(r) = *list;
            return {};
          }};
}

/// A list of any length, each from `least` to `most`.
template <typename Member>
Field list_of_numbers(Member member, double least, double most, bool whole) {
  Schema items = {{"type", whole ? "integer" : "number"}, {"minimum", least}, {"maximum", most}};
  return {member,
          {{"type", "array"}, {"items", items}, {"minItems", 1}, {"maxItems", 3000}},
          [=](JobRequest& r, const Value& v) -> std::string {
            const auto list = numbers_in(v);
            if (!list || list->empty() || list->size() > 3000 ||
                !std::all_of(list->begin(), list->end(), [&](double d) {
                  return d >= least && d <= most && (!whole || d == std::floor(d));
                })) {
              return expected(v, fmt::format("a list of {} from {:g} to {:g}",
                                             whole ? "whole numbers" : "numbers", least, most));
            }
            member(r) = *list;
            return {};
          }};
}

template <typename Member>
Field texts(Member member, const std::string& what) {
  return {member,
          {{"type", "array"}, {"items", {{"type", "string"}}}, {"minItems", 1}, {"maxItems", 100}},
          [=](JobRequest& r, const Value& v) -> std::string {
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
  return {member, {{"type", "boolean"}}, [=](JobRequest& r, const Value& v) -> std::string {
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

/// Longest list of a setting.
constexpr std::size_t kMostNumbers = 1000000;

/// Sets what `settings()` have; gives what was expected where the value is another.
std::string set_setting(const Setting& s, JobRequest& r, const Value& v) {
  const auto is_text = [&] { return std::get_if<std::string>(&v.value); };
  return std::visit(
      [&](auto chosen) -> std::string {
        auto& member = r.setup.*chosen;
        using Member = std::decay_t<decltype(member)>;
        if constexpr (std::is_same_v<Member, std::string>) {
          const auto d = s.or_inf ? number_in(v) : std::nullopt;
          const auto* text = is_text();
          if (d && takes_number(s, *d)) {
            member = fmt::format("{}", *d);
          } else if (!d && text && !text->empty() &&
                     (takes_text(s, *text) || (s.name == "mode" && *text == kTomographyMode))) {
            member = *text;
          } else {
            std::string what = setting_takes(s);
            if (s.name == "mode") what += fmt::format(", {}", kTomographyMode);
            if (what == "a text") what = "a name or a .toml file";
            return expected(v, what);
          }
        } else if constexpr (std::is_same_v<Member, std::vector<double>>) {
          const auto list = numbers_in(v);
          if (!list || list->empty() || list->size() > kMostNumbers ||
              !std::all_of(list->begin(), list->end(),
                           [&](double d) { return takes_number(s, d); })) {
            return expected(v, fmt::format("a list, each {}", setting_takes(s)));
          }
          member = *list;
        } else {
          const auto d = number_in(v);
          if (!d || !takes_number(s, *d)) return expected(v, setting_takes(s));
          member = static_cast<Member>(*d);
        }
        return {};
      },
      s.chosen);
}

Schema setting_schema(const Setting& s) {
  Schema schema;
  if (std::holds_alternative<std::vector<double> SetupChoices::*>(s.chosen)) {
    schema = {{"type", "array"}, {"items", number_schema(s.range)}, {"minItems", 1}};
  } else if (s.or_inf) {
    schema = {{"oneOf", {number_schema(s.range), {{"type", "string"}, {"enum", {"inf"}}}}}};
  } else if (std::holds_alternative<std::string SetupChoices::*>(s.chosen)) {
    schema = {{"type", "string"}};
    if (!s.words.empty()) schema["enum"] = s.words;
    if (s.name == "mode") schema["enum"].push_back(kTomographyMode);
  } else {
    schema = number_schema(s.range);
  }
  schema["description"] = setting_text(ChoiceNames::fields, s);
  schema["x-group"] = s.group;
  return schema;
}

Field setting_field(const Setting& s) {
  return std::visit(
      [&](auto chosen) {
        return Field(
            [chosen](JobRequest & r) -> auto& { return r.setup.*chosen; }, setting_schema(s),
            [&s](JobRequest& r, const Value& v) { return set_setting(s, r, v); });
      },
      s.chosen);
}

#define SLICEFARM_FIELD(path) ([](JobRequest & r) -> auto& { return r.path; })

using Fields = std::map<std::string, Field, std::less<>>;

/// The settings of printer, resin and process, and what jobs have beside them.
const Fields& fields() {
  static const Fields table = [] {
    Fields t;
    for (const Setting& s : settings()) {
      if (s.said_by != SaidBy::library) t.emplace(s.name, setting_field(s));
    }
    const auto add = [&](const char* name, Field field, const char* words) {
      t.emplace(name, std::move(field).of(words));
    };
    add("part", texts(SLICEFARM_FIELD(parts), "the path of a mesh, an archive or a volume"),
        "The part: a mesh, an archive of slices or a volume; over HTTP an upload");
    add("parts", texts(SLICEFARM_FIELD(parts), "paths of meshes that share the plate"),
        "Meshes that share the plate; over HTTP uploads");
    add("layer_um", number(SLICEFARM_FIELD(layer_um), 1, 1000),
        "Height of slices; an archive says it itself");
    add("adaptive_um", numbers(SLICEFARM_FIELD(adaptive_um), 2).in(kMade),
        "LOW and HIGH: layers of a mesh as high as slopes allow, in multiples of LOW up to HIGH, in "
        "place of layer_um");
    add("antialias", word(SLICEFARM_FIELD(antialias), {"on", "off"}),
        "Grey pixels where an outline goes through them");
    add("units", word(SLICEFARM_FIELD(units), {"auto", "mm", "inch", "m"}), "Unit of the meshes");
    add("scale", number(SLICEFARM_FIELD(scale), 0, kMost, true), "Factor of the meshes' size");
    add("fit_mm", number(SLICEFARM_FIELD(fit_mm), 0, kMost, true),
        "Longest side of all parts together, in place of scale");
    add("center_mm", numbers(SLICEFARM_FIELD(center_mm), 2),
        "Where the middle lies on the plate, x and y");
    add("rotate_deg", numbers(SLICEFARM_FIELD(rotate_deg), 3), "Turned about x, y and z");
    add("overlap", word(SLICEFARM_FIELD(plate.overlap), {"refuse", "join"}),
        "Parts whose solids overlap: refuse them, or join them to their union");
    add("arrange", flag(SLICEFARM_FIELD(plate.arrange)),
        "Parts lie side by side, not as in their files");
    add("spacing_mm", number(SLICEFARM_FIELD(plate.spacing_mm), 0, 1000),
        "Least distance of parts that are arranged");
    add("turn_about_z", flag(SLICEFARM_FIELD(plate.turn_about_z)),
        "Arranged parts may be turned by quarter turns");
    add("places_mm", list_of_numbers(SLICEFARM_FIELD(plate.places_mm), -1e6, 1e6, false),
        "x and y on the plate of the middle of each part, in place of its file");
    add("quarter_turns", list_of_numbers(SLICEFARM_FIELD(plate.quarter_turns), 0, 3, true),
        "By how many quarters each of these parts is turned about z");
    add("own_fit_mm", list_of_numbers(SLICEFARM_FIELD(plate.own_fit_mm), 0, 1e5, false),
        "Longest side of each part by itself; 0: as all");
    add("own_scale", list_of_numbers(SLICEFARM_FIELD(plate.own_scale), 0, 1e9, false),
        "Factor of the size of each part by itself; 0: as all");
    add("own_rotate_deg", list_of_numbers(SLICEFARM_FIELD(plate.own_rotate_deg), -1e6, 1e6, false),
        "Each part turned by itself about x, y and z: three numbers for each");
    add("voxel_mm", number(SLICEFARM_FIELD(voxel_mm), 0, kMost, true),
        "Side of a voxel (tomographic)");
    add("method", word(SLICEFARM_FIELD(method), {"ladder", "osmo", "kelly", "fbp"}),
        "How light is found (tomographic)");
    add("window", word(SLICEFARM_FIELD(window), {"hamming", "ram-lak", "kelly"}),
        "Of the filter that it starts from (tomographic)");
    add("angles", whole(SLICEFARM_FIELD(angles), 3, 100000), "Frames of a turn (tomographic)");
    add("iterations", whole(SLICEFARM_FIELD(iterations), 1, 100000), "Steps (tomographic)");
    add("leave_alone", texts(SLICEFARM_FIELD(leave_alone), "paths of meshes or stacks"),
        "Meshes and stacks of what is shown as it is sliced: supports, rafts");
    add("part_inside", texts(SLICEFARM_FIELD(part_inside), "paths of meshes"),
        "Meshes that the archive holds: what it lights outside of them, supports and rafts, is left alone");
    add("insert", texts(SLICEFARM_FIELD(inserts), "paths of meshes or volumes"),
        "What turns with the part (tomographic)");
    add("clip_sigma", number(SLICEFARM_FIELD(clip_sigma), 0, kMost, true),
        "OSMO: cut off light above the mean and so many standard deviations (tomographic)");
    add("stop_error", number(SLICEFARM_FIELD(stop_error), 0, kMost, true),
        "OSMO: stop when doses are wrong by less than this share (tomographic)");
    add("max_time_s", number(SLICEFARM_FIELD(max_time_s), 0, kMost, true),
        "Refuse what takes longer to print (tomographic)");
    add("beyond_reach", flag(SLICEFARM_FIELD(beyond_reach)),
        "Parts may reach further than light from all directions (tomographic)");
    add("plan", flag(SLICEFARM_FIELD(plan)),
        "The speed, or layer by layer the exposure, is found for the part");
    add("uncertain",
        text(SLICEFARM_FIELD(uncertain), "errors of inputs, as in ha=5%,dc=5%").in(kMade),
        "By how much inputs may be off: ha=5%,dc=5%, or fit");
    add("robust", flag(SLICEFARM_FIELD(robust)).in(kMade),
        "The correction allows for all that uncertain names");
    add("tolerance_um", number(SLICEFARM_FIELD(tolerance_um), 0, kMost, true),
        "How far edges may lie from the design (plan)");
    add("gap_contrast", number(SLICEFARM_FIELD(gap_contrast), 0, 1, true),
        "1 less the least dose that gaps are to have (plan)");
    add("name", text(SLICEFARM_FIELD(name), "a file name without its ending"),
        "File name of the outputs, without ending");
    add("format", text(SLICEFARM_FIELD(format), "a format of archives, or its ending").in(kMade),
        "Format of the archive");
    add("for", text(SLICEFARM_FIELD(machine), "the name of a machine").in(kMade),
        "Machine of machines.toml that is to print it: says printer and format");
    add("out", text(SLICEFARM_FIELD(out), "a folder"), "Folder of the outputs");
    add("copies", whole(SLICEFARM_FIELD(copies), 1, 10000), "How many jobs of it");
    add("priority", whole(SLICEFARM_FIELD(priority), -1000000, 1000000), "Larger comes first");
    add("ready_by", text(SLICEFARM_FIELD(ready_by), "HH:MM or YYYY-MM-DD HH:MM"),
        "When it is to be done: HH:MM, or YYYY-MM-DD HH:MM");
    add("labels", texts(SLICEFARM_FIELD(labels), "words"), "Words to find it by");
    add("user", text(SLICEFARM_FIELD(user), "a name"),
        "Whose job it is; over HTTP of an account that may operate");
    return t;
  }();
  return table;
}
#undef SLICEFARM_FIELD

/// Fields of every job, and of which tomographic prints have more.
const std::set<std::string, std::less<>> kOfAll{
    "part",   "parts",    "printer",  "resin",  "layer_um", "mode",   "name", "out",
    "copies", "priority", "ready_by", "labels", "user",     "format", "for"};
const std::set<std::string, std::less<>> kOfMeshes{"units", "scale", "fit_mm", "rotate_deg"};
/// Of meshes that are sliced, besides those.
const std::set<std::string, std::less<>> kOfPlates{
    "antialias", "center_mm",     "overlap",    "arrange",   "spacing_mm",    "turn_about_z",
    "places_mm", "quarter_turns", "own_fit_mm", "own_scale", "own_rotate_deg"};
const std::set<std::string, std::less<>> kOfTomography{
    "voxel_mm",   "method",       "window", "angles",     "iterations",
    "max_time_s", "beyond_reach", "insert", "clip_sigma", "stop_error"};

}  // namespace

JobKind kind_of(const JobRequest& r) {
  if (r.setup.mode != kTomographyMode) {
    if (r.parts.empty() || std::any_of(r.parts.begin(), r.parts.end(), is_mesh_name)) {
      return JobKind::meshes;
    }
    return r.part_inside.empty() ? JobKind::archive : JobKind::archive_around_part;
  }
  return std::any_of(r.parts.begin(), r.parts.end(), is_volume) ? JobKind::tomographic_volume
                                                                : JobKind::tomographic_mesh;
}

std::string misfit(const std::string& key, const std::string& name, JobKind kind) {
  if (kOfAll.contains(key)) return {};
  if (!is_tomographic(kind)) {
    const bool sliced = kOfPlates.contains(key) ||
                        (kOfMeshes.contains(key) && kind != JobKind::archive_around_part);
    if (sliced && kind != JobKind::meshes) {
      return fmt::format("{} is for meshes; the slices of an archive stay as they are", name);
    }
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

void unset_field(JobRequest& request, const std::string& key) {
  fields().find(key)->second.unset(request);
}

std::string work_text(const JobRequest& request) {
  /// What a job is called and when it is done, not what is made.
  static const std::set<std::string, std::less<>> beside{
      "name", "out", "copies", "priority", "ready_by", "labels", "user", "format", "for"};
  std::string text;
  for (const auto& [key, field] : fields()) {
    if (!beside.contains(key)) text += key + "=" + field.show(request) + "\n";
  }
  return text;
}

nlohmann::ordered_json field_schemas() {
  // Settings first, by heading, in the order of their table.
  Schema all = Schema::object();
  for (const std::string_view heading : kSettingGroups) {
    for (const Setting& s : settings()) {
      const auto found = fields().find(s.name);
      if (s.group == heading && found != fields().end()) all[found->first] = found->second.schema;
    }
  }
  for (const auto& [name, field] : fields()) {
    if (!all.contains(name)) all[name] = field.schema;
  }
  // One path may stand alone.
  all["part"] = {{"type", "string"}, {"description", all["part"]["description"]}};
  return all;
}

std::vector<std::string> field_names() {
  std::vector<std::string> names;
  for (const auto& [name, set] : fields()) names.push_back(name);
  return names;
}

void expand_copies(JobRequest& r) {
  cli::MeshOptions o;
  o.parts = r.parts;
  const std::vector<std::string> files = o.files();
  if (files.size() == r.parts.size()) return;
  if (is_tomographic(kind_of(r))) {
    throw InputError(r.parts[0], "", "copies have no place in a tomographic print");
  }
  r.plate = cli::for_copies(r.plate, r.parts);
  r.parts = files;
  if (r.plate.places_mm.empty()) r.plate.arrange = true;
}

void make_paths_absolute(JobRequest& r, const std::string& folder) {
  const auto absolute = [&](std::string& path) {
    if (!path.empty()) path = (fs::absolute(folder) / path).lexically_normal().string();
  };
  for (std::string& p : r.parts) absolute(p);
  for (std::string& p : r.leave_alone) absolute(p);
  for (std::string& p : r.part_inside) absolute(p);
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
