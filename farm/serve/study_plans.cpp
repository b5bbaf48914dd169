// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// What may be asked in a study, and the programs that answer it. Nothing of a request reaches a
// command line but numbers, words of a fixed form and the paths of uploads.

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <filesystem>
#include <fstream>
#include <optional>
#include <set>

#include "serve/studies.hpp"
#include "serve/uploads.hpp"
#include "slicecorr/mesh.hpp"
#include "slicecorr/settings.hpp"
#include "support/files/text_file.hpp"
#include "support/json/read_json.hpp"

namespace slicecorr::farm::detail {

namespace {

using http::ApiError;
using Json = nlohmann::ordered_json;
using Arguments = std::vector<std::string>;

constexpr std::size_t kMostParts = 100;

enum class Kind { number, word, numbers, list, flag };

/// A key of a request and the option that it becomes. The program checks the range.
struct Option {
  const char* key;
  const char* option;
  Kind kind;
  std::size_t count = 1;  ///< of numbers
};

constexpr Option kPlacing[] = {
    {"antialias", "--antialias", Kind::word},
    {"units", "--units", Kind::word},
    {"scale", "--scale", Kind::number},
    {"fit_mm", "--fit-mm", Kind::number},
    {"rotate_deg", "--rotate-deg", Kind::numbers, 3},
    {"center_mm", "--center-mm", Kind::numbers, 2},
    {"overlap", "--overlap", Kind::word},
    {"arrange", "--arrange", Kind::flag},
    {"spacing_mm", "--spacing-mm", Kind::number},
    {"turn_about_z", "--turn-about-z", Kind::flag},
    {"places_mm", "--places-mm", Kind::list},
    {"quarter_turns", "--quarter-turns", Kind::list},
    {"own_fit_mm", "--own-fit-mm", Kind::list},
    {"own_scale", "--own-scale", Kind::list},
    {"own_rotate_deg", "--own-rotate-deg", Kind::list},
};
constexpr Option kPlanning[] = {
    {"tolerance_um", "--tolerance-um", Kind::number},
    {"gap_contrast", "--gap-contrast", Kind::number},
    {"light_error_percent", "--light-error-percent", Kind::number},
    {"least_gap_um", "--least-gap-um", Kind::number},
};
constexpr Option kFitting[] = {
    {"weights", "--weights", Kind::word},
    {"loss", "--loss", Kind::word},
    {"bootstrap", "--bootstrap", Kind::number},
};

bool is_word(const std::string& text, std::size_t most) {
  return !text.empty() && text.size() <= most && text[0] != '-' && text[0] != '.' &&
         std::all_of(text.begin(), text.end(), [](char c) {
           return (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || c == '-' || c == '_' ||
                  c == '.';
         });
}

[[noreturn]] void wrong(const std::string& key, const std::string& expected) {
  throw ApiError(400, "study", key + ": expected " + expected);
}

std::string number_of(const Json& value, const char* key) {
  if (!value.is_number() || !std::isfinite(value.get<double>())) wrong(key, "a number");
  return value.is_number_integer() ? fmt::format("{}", value.get<std::int64_t>())
                                   : fmt::format("{}", value.get<double>());
}

std::string argument_of(const Option& option, const Json& value) {
  std::string text;
  switch (option.kind) {
    case Kind::number:
      text = number_of(value, option.key);
      break;
    case Kind::word:
      if (!value.is_string() || !is_word(value.get<std::string>(), 20)) wrong(option.key, "a word");
      text = value.get<std::string>();
      break;
    case Kind::numbers:
      if (!value.is_array() || value.size() != option.count) {
        wrong(option.key, fmt::format("{} numbers", option.count));
      }
      for (const Json& v : value) text += (text.empty() ? "" : ",") + number_of(v, option.key);
      break;
    case Kind::list:
      if (!value.is_array() || value.empty() || value.size() > 3 * kMostParts) {
        wrong(option.key, "a list of numbers for each part");
      }
      for (const Json& v : value) text += (text.empty() ? "" : ",") + number_of(v, option.key);
      break;
    case Kind::flag:
      if (!value.is_boolean()) wrong(option.key, "true or false");
      return value.get<bool>() ? std::string(option.option) : std::string();
  }
  return std::string(option.option) + "=" + text;
}

/// A value of a setting that is no list, checked.
std::string setting_value(const Setting& s, const Json& value) {
  const std::string key(s.name);
  if (value.is_number() && (s.words.empty())) {
    if (!takes_number(s, value.get<double>())) wrong(key, setting_takes(s));
    return number_of(value, key.c_str());
  }
  const bool texts = std::holds_alternative<std::string SetupChoices::*>(s.chosen);
  if (!texts || !value.is_string() || !is_word(value.get<std::string>(), 20) ||
      !takes_text(s, value.get<std::string>())) {
    wrong(key, setting_takes(s));
  }
  return value.get<std::string>();
}

/// A list as the table that programs read.
std::string setting_table(const Setting& s, const Json& value) {
  constexpr std::size_t most = 100000;
  std::string text = fmt::format("slice,{}\n", s.column);
  if (!value.is_array() || value.empty() || value.size() > most)
    wrong(std::string(s.name), "a list");
  for (std::size_t n = 0; n < value.size(); ++n) {
    if (!value[n].is_number() || !takes_number(s, value[n].get<double>())) {
      wrong(std::string(s.name), "a list, each " + setting_takes(s));
    }
    text += fmt::format("{},{}\n", n, value[n].get<double>());
  }
  return text;
}

/// A request whose keys are taken one after the other.
class Asked {
 public:
  Asked(const FarmFolder& folder, const Json& json) : folder_(folder), json_(json) {
    taken_.insert("kind");
  }

  const Json* find(const char* key) {
    taken_.insert(key);
    const auto at = json_.find(key);
    return at == json_.end() || at->is_null() ? nullptr : &*at;
  }
  const Json& required(const char* key, const char* expected) {
    const Json* value = find(key);
    if (!value) wrong(key, expected);
    return *value;
  }
  template <std::size_t N>
  void add(Arguments& arguments, const Option (&options)[N]) {
    for (const Option& option : options) {
      if (const Json* value = find(option.key)) {
        if (std::string text = argument_of(option, *value); !text.empty()) {
          arguments.push_back(std::move(text));
        }
      }
    }
  }
  /// What is said of the process, by the table of settings: as arguments, and lists as tables that
  /// these name. `without`: settings that are checked, and passed over.
  void add_process(StudyPlan& plan, Arguments& arguments,
                   std::initializer_list<std::string_view> without = {}) {
    for (const Setting& s : settings()) {
      // Definitions are chosen by names of the database.
      if (s.said_by != SaidBy::all || s.name == "printer" || s.name == "resin") continue;
      const std::string key(s.name);
      const Json* const value = find(key.c_str());
      if (!value) continue;
      const std::string option = setting_name(ChoiceNames::options, s.name) + "=";
      const bool passed = std::find(without.begin(), without.end(), s.name) != without.end();
      if (s.column.empty()) {
        const std::string text = setting_value(s, *value);
        if (!passed) arguments.push_back(option + text);
        continue;
      }
      const std::string table = setting_table(s, *value);
      if (passed) continue;
      plan.tables.emplace_back(key + ".csv", table);
      arguments.push_back(option + key + ".csv");
    }
  }
  Arguments uploads(const char* key) {
    const Json& list = required(key, "a list of uploads");
    if (!list.is_array() || list.empty() || list.size() > kMostParts) {
      wrong(key, fmt::format("a list of 1 to {} uploads", kMostParts));
    }
    Arguments paths;
    for (const Json& each : list) {
      const std::string path =
          each.is_string() ? upload_path(folder_, each.get<std::string>()) : std::string();
      std::error_code error;
      if (path.empty() || !std::filesystem::is_regular_file(path, error)) {
        wrong(key, "uploads (\"upload:...\") that are still there");
      }
      paths.push_back(path);
    }
    return paths;
  }
  /// Throws for keys that nobody took.
  void end() const {
    for (const auto& [key, value] : json_.items()) {
      if (!taken_.contains(key)) {
        throw ApiError(400, "study", "has a key that this kind of study does not take");
      }
    }
  }

 private:
  const FarmFolder& folder_;
  const Json& json_;
  std::set<std::string> taken_;
};

Arguments joined(std::initializer_list<Arguments> lists) {
  Arguments all;
  for (const Arguments& list : lists) all.insert(all.end(), list.begin(), list.end());
  return all;
}

/// The row of the image in which the worst place lies, by the figures of a check; none without one.
std::optional<int> worst_row(const std::string& path) {
  const Json json = slicecorr::detail::try_json<Json>(text_of_file(path).value_or(""));
  const auto worst = json.is_object() ? json.find("worst_pixel") : json.end();
  if (worst == json.end() || !worst->is_array() || worst->size() != 2) return {};
  const int row = (*worst)[1].is_number_integer() ? (*worst)[1].get<int>() : -1;
  return row >= 0 ? std::optional<int>(row) : std::nullopt;
}

StudyStep fixed(const std::string& what, Arguments arguments) {
  return {what, [arguments = std::move(arguments)](const std::string&) { return arguments; }};
}

StudyStep section_step(const std::string& design) {
  return {"drawing the section", [design](const std::string& folder) {
            Arguments arguments{"slicecorr", "section", "check.uvj",  "--target",
                                design,      "-o",      "section.png"};
            if (const auto row = worst_row(folder + "/check.json")) {
              arguments.push_back(fmt::format("--y={}", *row));
            }
            return arguments;
          }};
}

/// Parts with where they are printed: what all studies of parts have.
struct PartsAsked {
  Arguments paths, printer, resin, layer, placing;
  Arguments inside;      ///< of an archive: its parts, as options of `slicecorr`
  bool archive = false;  ///< one archive of slices in place of meshes
};

PartsAsked parts_asked(Asked& asked, bool with_resin) {
  PartsAsked p;
  p.paths = asked.uploads("parts");
  p.printer = {"--printer=" + checked_name(asked.required("printer", "a name"), "printer")};
  // A plate needs no resin; that it is named does no harm.
  if (const Json* resin = asked.find("resin"))
    p.resin = {"--resin=" + checked_name(*resin, "resin")};
  if (with_resin && p.resin.empty()) wrong("resin", "a name");
  p.archive = !is_mesh_name(p.paths[0]);
  for (const std::string& path : p.paths) {
    if (p.paths.size() > 1 && !is_mesh_name(path))
      wrong("parts", "meshes, or one archive of slices");
  }
  if (const Json* layer = asked.find("layer_um")) {
    p.layer = {"--layer-um=" + number_of(*layer, "layer_um")};
  } else if (!p.archive) {
    wrong("layer_um", "the height of slices");
  }
  Arguments placing;
  asked.add(placing, kPlacing);
  if (asked.find("part_inside")) {
    if (!p.archive) wrong("part_inside", "an archive of slices with it");
    for (const std::string& path : asked.uploads("part_inside")) {
      if (!is_mesh_name(path)) wrong("part_inside", "meshes");
      p.inside.push_back("--part=" + path);
    }
    for (const std::string& how : placing) {
      for (const char* option : {"--units", "--scale", "--fit-mm", "--rotate-deg"}) {
        if (how.starts_with(option)) p.inside.push_back(how);
      }
    }
  }
  // Slices lie where they lie.
  if (!p.archive) p.placing = std::move(placing);
  return p;
}

StudyPlan plate_plan(Asked& asked) {
  const PartsAsked p = parts_asked(asked, false);
  StudyPlan plan;
  plan.kind = "plate";
  plan.files = {"plate.json", "plate.bin"};
  if (p.archive) {
    plan.steps = {
        fixed("reading the layers",
              joined({{"slicefarm", "plate", "--stack", p.paths[0]}, p.printer, p.layer}))};
    return plan;
  }
  Arguments placing = p.placing;
  plan.steps.push_back(fixed(
      "slicing",
      joined(
          {{"slicecorr", "slice"}, p.paths, p.printer, p.layer, placing, {"-o", "design.uvj"}})));
  std::erase_if(placing, [](const std::string& a) { return a.starts_with("--antialias"); });
  plan.steps.push_back(fixed(
      "drawing",
      joined({{"slicefarm", "plate", "--stack", "design.uvj"}, p.paths, p.printer, placing})));
  return plan;
}

StudyPlan speed_plan(Asked& asked) {
  const PartsAsked p = parts_asked(asked, true);
  StudyPlan plan;
  Arguments process;
  // The speed is what is asked.
  asked.add_process(
      plan, process,
      {"speed_mm_h", "exposure_s", "slice_speed_mm_h", "layer_exposure_s", "light_share"});
  asked.add(process, kPlanning);
  plan.kind = "plan";
  plan.files = {"plan.json", "plan.svg"};
  plan.steps = {fixed("finding the speed", joined({{"slicecorr", "plan"},
                                                   p.paths,
                                                   p.printer,
                                                   p.resin,
                                                   p.layer,
                                                   p.placing,
                                                   process,
                                                   {"--json", "plan.json", "-o", "plan.svg"}}))};
  return plan;
}

StudyPlan check_plan(Asked& asked) {
  const PartsAsked p = parts_asked(asked, true);
  StudyPlan plan;
  Arguments process;
  asked.add_process(plan, process);
  plan.kind = "check";
  plan.files = {"check.json", "check.html", "section.png"};
  if (p.archive) {
    const std::string& design = p.paths[0];
    plan.steps = {
        fixed("correcting", joined({{"slicecorr", "correct", design, "-o", "check.uvj"},
                                    p.printer,
                                    p.resin,
                                    p.layer,
                                    p.inside,
                                    process})),
        fixed("predicting", joined({{"slicecorr", "verify", "check.uvj", "--target", design,
                                     "--json", "check.json"},
                                    p.layer,
                                    p.inside})),
        fixed("drawing",
              joined({{"slicecorr", "report", "check.uvj", "--target", design, "-o", "check.html"},
                      p.inside})),
        section_step(design)};
    return plan;
  }
  plan.steps = {fixed("slicing, correcting and predicting", joined({{"slicecorr", "run"},
                                                                    p.paths,
                                                                    p.printer,
                                                                    p.resin,
                                                                    p.layer,
                                                                    p.placing,
                                                                    process,
                                                                    {"-o", "check.uvj"}})),
                fixed("slicing the design", joined({{"slicecorr", "slice"},
                                                    p.paths,
                                                    p.printer,
                                                    p.layer,
                                                    p.placing,
                                                    {"-o", "design.uvj"}})),
                section_step("design.uvj")};
  return plan;
}

StudyPlan fit_plan(Asked& asked) {
  const Arguments data = asked.uploads("data");
  for (const std::string& path : data) {
    if (!path.ends_with(".csv")) wrong("data", "tables of measurements (.csv)");
  }
  const Json& model = asked.required("model", "jacobs, kinetic, gel-time, ...");
  if (!model.is_string() || !is_word(model.get<std::string>(), 20)) wrong("model", "a word");
  StudyPlan plan;
  plan.kind = "fit";
  plan.name = checked_name(asked.required("name", "the name of the resin"), "name");
  Arguments law{"--model=" + model.get<std::string>()}, how;
  if (const Json* resin = asked.find("resin")) {
    law.push_back("--resin=" + checked_name(*resin, "resin"));
  }
  asked.add(how, kFitting);
  plan.files = {"fit.json", "fit.svg", plan.name + ".toml"};
  plan.steps = {
      fixed("fitting",
            joined({{"resinctl", "fit"},
                    data,
                    law,
                    how,
                    {"--name=" + plan.name, "-o", plan.name + ".toml", "--json", "fit.json"}})),
      fixed("drawing", joined({{"resinctl", "plot"}, data, law, {"-o", "fit.svg"}}))};
  return plan;
}

}  // namespace

std::string checked_name(const Json& value, const char* key) {
  if (!value.is_string() || !is_word(value.get<std::string>(), 100) ||
      value.get<std::string>().ends_with(".toml")) {
    wrong(key, "a name of small letters, digits, '-', '_' and '.'");
  }
  return value.get<std::string>();
}

bool is_placing(std::string_view key) {
  return key == "layer_um" || std::any_of(std::begin(kPlacing), std::end(kPlacing),
                                          [&](const Option& o) { return key == o.key; });
}

StudyPlan plan_study(const FarmFolder& folder, const Json& request) {
  const auto kind = request.find("kind");
  Asked asked(folder, request);
  StudyPlan plan;
  if (kind != request.end() && *kind == "plate") {
    plan = plate_plan(asked);
  } else if (kind != request.end() && *kind == "plan") {
    plan = speed_plan(asked);
  } else if (kind != request.end() && *kind == "check") {
    plan = check_plan(asked);
  } else if (kind != request.end() && *kind == "fit") {
    plan = fit_plan(asked);
  } else {
    throw ApiError(400, "study", "kind: expected plate, plan, check or fit");
  }
  asked.end();
  return plan;
}

}  // namespace slicecorr::farm::detail
