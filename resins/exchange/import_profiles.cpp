// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Profiles of slicers: exposure times by layer height.
#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <regex>
#include <set>

#include "exchange/import.hpp"
#include "slicecorr/error.hpp"
#include "support/text/ascii.hpp"
#include "support/text/csv.hpp"

namespace slicecorr::resins {

namespace {

struct Preset {
  int line = 0;
  std::map<std::string, std::string> values;
};

/// Regular expressions need stack for every character: no setting is as long as this.
constexpr std::size_t kMostCharacters = 1000;

/// Lines of a text that are not empty and begin with none of `comments`, numbered from 1.
template <typename Take>
void each_line(const std::string& text, std::string_view comments, Take take) {
  int number = 1;
  for (std::size_t at = 0; at < text.size(); ++number) {
    const std::size_t end = std::min(text.find('\n', at), text.size());
    std::string line(trimmed(std::string_view(text).substr(at, end - at)));
    if (number == 1 && line.starts_with("\xEF\xBB\xBF")) line.erase(0, 3);
    if (!line.empty() && comments.find(line[0]) == std::string_view::npos) take(number, line);
    at = end + 1;
  }
}

/// Sections [sla_material:NAME]; a file without sections is one material of the name "".
std::map<std::string, Preset> materials_of(const std::string& text) {
  std::map<std::string, Preset> presets;
  std::string section;
  bool any_section = false, in_material = true;
  constexpr std::string_view head = "[sla_material:";
  each_line(text, "#;", [&](int number, const std::string& line) {
    if (line.front() == '[' && line.back() == ']') {
      if (!any_section) presets.clear();  // what came before was no preset
      any_section = true;
      in_material = line.starts_with(head);
      if (!in_material) return;
      section = line.substr(head.size(), line.size() - head.size() - 1);
      presets[section].line = number;
      return;
    }
    const std::size_t equals = line.find('=');
    if (!in_material || equals == std::string::npos) return;
    Preset& preset = presets[section];
    if (preset.line == 0) preset.line = number;
    preset.values[std::string(trimmed(line.substr(0, equals)))] = trimmed(line.substr(equals + 1));
  });
  return presets;
}

/// Printers of a bundle that cure resin; those that melt plastic nobody takes for one of ours.
void leave_out_printers(const ImportSource& source) {
  std::string printer;
  each_line(source.text, "#;", [&](int number, const std::string& line) {
    constexpr std::string_view head = "[printer:";
    if (line.front() == '[') {
      printer = line.starts_with(head) ? line.substr(head.size(), line.size() - head.size() - 1)
                                       : std::string();
    } else if (!printer.empty() && line.starts_with("display_pixels_x")) {
      source.leave_out(fmt::format(
          "line {}: '{}' is a printer, not a resin; 'resinctl new-printer' makes a printer file",
          number, printer));
    }
  });
}

/// Follows the inheritance of presets.
class Resolver {
 public:
  Resolver(const std::map<std::string, Preset>& presets, const std::string& path)
      : presets_(presets), path_(path) {}

  /// Values of a preset with those it inherits; later parents count over earlier ones.
  std::map<std::string, std::string> values_of(const std::string& name) {
    const Preset& preset = presets_.at(name);
    if (!open_.insert(name).second) {
      throw InputError(path_, fmt::format("line {}", preset.line),
                       fmt::format("preset '{}' inherits from itself", name));
    }
    std::map<std::string, std::string> values;
    const auto inherits = preset.values.find("inherits");
    std::string_view rest;
    if (inherits != preset.values.end()) rest = inherits->second;
    while (!rest.empty()) {
      const std::size_t end = std::min(rest.find(';'), rest.size());
      const std::string parent(trimmed(rest.substr(0, end)));
      rest.remove_prefix(std::min(end + 1, rest.size()));
      if (parent.empty()) continue;
      if (!presets_.contains(parent)) {
        missing.insert(parent);
        continue;
      }
      for (auto& [key, value] : values_of(parent)) values[key] = value;
    }
    for (const auto& [key, value] : preset.values) values[key] = value;
    open_.erase(name);
    return values;
  }

  std::set<std::string> missing;  ///< parents that the file does not have

 private:
  const std::map<std::string, Preset>& presets_;
  const std::string& path_;
  std::set<std::string> open_;
};

std::string value_of(const std::map<std::string, std::string>& values, const std::string& key) {
  const auto at = values.find(key);
  return at == values.end() ? "" : at->second;
}

struct Group {
  ResinDraft draft;
  std::vector<LayerExposure> exposures;
  std::string presets;
};

/// Layer height of a preset in um, and the key that says it.
std::pair<double, std::string> layer_of(const std::map<std::string, std::string>& values,
                                        const std::string& in_name) {
  static const std::regex condition(R"(layer_height\s*==\s*([0-9.]+))");
  std::smatch found;
  const std::string prints = value_of(values, "compatible_prints_condition");
  if (prints.size() <= kMostCharacters && std::regex_search(prints, found, condition)) {
    if (const auto v = number_in_text(found[1].str())) {
      return {*v * 1000, "compatible_prints_condition"};
    }
  }
  if (const auto v = number_in_text(in_name)) return {*v * 1000, "the preset's name"};
  for (const char* key : {"layer_height", "initial_layer_height"}) {
    if (const auto v = number_in_text(value_of(values, key))) return {*v * 1000, key};
  }
  return {0, ""};
}

}  // namespace

bool is_exposure_key(const std::string& key) {
  // Names of the same setting in profiles of several programs.
  static const std::set<std::string> known = {
      "exposuretime",   "normalexposuretime", "lightontime",      "normallayerexposuretime",
      "normalexposure", "exposuretimes",      "layerexposuretime"};
  return known.contains(key);
}

std::vector<Imported> import_prusaslicer(const ImportSource& source, const ImportOptions& options) {
  if (options.intensity_mw_cm2 <= 0) {
    throw InputError(
        source.path, "",
        "a profile gives times only; expected --intensity-mw-cm2, that of the printer");
  }
  const auto presets = materials_of(source.text);
  static const std::regex at_height(R"(^(.*?)\s*@\s*([0-9.]+)\s*(?:mm)?\s*(.*)$)");
  std::map<std::string, Group> groups;
  for (const auto& [name, preset] : presets) {
    if (name.starts_with("*")) continue;  // hidden: only there to be inherited
    Resolver resolver(presets, source.path);
    const auto values = resolver.values_of(name);
    std::string full = name.empty() ? value_of(values, "sla_material_settings_id") : name;
    if (full.empty()) full = source.file.substr(0, source.file.rfind('.'));
    if (full.find(options.only) == std::string::npos) continue;
    std::smatch parts;
    const bool has_height =
        full.size() <= kMostCharacters && std::regex_match(full, parts, at_height);
    const std::string base = has_height ? parts[1].str() : full;
    const std::string variant(has_height ? trimmed(parts[3].str()) : "");
    const auto exposure = number_in_text(value_of(values, "exposure_time"));
    const auto [layer_um, said_by] = layer_of(values, has_height ? parts[2].str() : "");
    const std::string place = fmt::format("line {}: preset '{}'", preset.line, full);
    if (!exposure || *exposure <= 0) {
      source.leave_out(place + ": has no exposure_time above 0");
      continue;
    }
    if (layer_um <= 0 || layer_um > 1000) {
      source.leave_out(place + ": has no layer height");
      continue;
    }
    Group& group = groups[variant.empty() ? base : base + " " + variant];
    ResinDraft& d = group.draft;
    if (group.exposures.empty()) {
      d.name = stable_name_of(variant.empty() ? base : base + " " + variant);
      d.product = base;
      d.maker = value_of(values, "material_vendor");
      d.colour = value_of(values, "material_colour");
      d.notes = value_of(values, "material_type");
      if (const std::string printer = value_of(values, "compatible_printers_condition");
          !printer.empty()) {
        d.provenance.emplace_back("printer", printer);
      }
      d.assumptions.push_back(fmt::format("Layer heights are those of {}.", said_by));
    }
    for (const std::string& parent : resolver.missing) {
      d.assumptions.push_back(fmt::format(
          "Preset '{}' inherits '{}', which the file does not have; it was read without.", full,
          parent));
    }
    group.exposures.push_back({layer_um, *exposure});
    group.presets += (group.presets.empty() ? "" : ", ") + full;
  }
  leave_out_printers(source);
  std::vector<Imported> made;
  for (auto& [name, group] : groups) {
    ResinDraft& d = group.draft;
    std::sort(group.exposures.begin(), group.exposures.end(),
              [](const auto& a, const auto& b) { return a.layer_um < b.layer_um; });
    if (groups.size() == 1 && !options.name.empty()) d.name = options.name;
    d.provenance.emplace_back("source", fmt::format("{}, presets {}", source.file, group.presets));
    const std::string problem = resin_of_exposures(group.exposures, options, d);
    if (!problem.empty()) {
      source.leave_out(fmt::format("resin '{}': {}", name, problem));
      continue;
    }
    made.push_back(finish_resin(d, source, "prusaslicer"));
  }
  return made;
}

std::vector<Imported> import_key_values(const ImportSource& source, const ImportOptions& options) {
  static const std::set<std::string> layer_keys = {"layerheight", "layerthickness", "zthick",
                                                   "layerheightmm", "layerthicknessmm"};
  static const std::set<std::string> name_keys = {"resinname", "resin",       "materialname",
                                                  "material",  "profilename", "name"};
  static const std::regex pair(R"(^[@;"\s]*([A-Za-z][^=:]*?)\s*[=:]\s*(.*?)\s*,?\s*$)");
  static const std::regex quantity(R"(^\"?([0-9.eE+-]+)\s*(mm|um|µm|μm|ms|s|sec)?\"?$)");
  double layer_um = 0, exposure_s = 0;
  ResinDraft draft;
  const auto take_line = [&](int number, const std::string& line) {
    std::smatch found;
    if (line.size() > kMostCharacters || !std::regex_match(line, found, pair)) return;
    std::string key, value = found[2].str();
    for (const char c : lower_case(found[1].str())) {
      if ((c >= 'a' && c <= 'z') || (c >= '0' && c <= '9')) key += c;
    }
    if (name_keys.contains(key) && draft.product.empty()) {
      if (value.size() > 1 && value.front() == '"' && value.back() == '"') {
        value = value.substr(1, value.size() - 2);
      }
      draft.product = value;
    }
    const bool exposure = is_exposure_key(key), layer = layer_keys.contains(key);
    if (!exposure && !layer) return;
    std::smatch parts;
    const auto v =
        std::regex_match(value, parts, quantity) ? number_in_text(parts[1].str()) : std::nullopt;
    const std::string place = fmt::format("line {}: {}", number, found[1].str());
    const double given = v.value_or(0);
    if (!(given > 0)) {
      throw InputError(source.path, place,
                       fmt::format("is '{}'; expected a number above 0", value));
    }
    const std::string unit = parts[2].str();
    if (exposure) {
      if (!unit.empty() && unit != "s" && unit != "sec" && unit != "ms") {
        throw InputError(source.path, place, fmt::format("is in {}; expected s or ms", unit));
      }
      const double seconds = unit == "ms" ? given / 1000 : given;
      if (exposure_s > 0 && exposure_s != seconds) {
        throw InputError(source.path, place,
                         fmt::format("gives a second exposure time, {:g} s after {:g} s; expected "
                                     "a profile of one resin",
                                     seconds, exposure_s));
      }
      exposure_s = seconds;
    } else {
      const bool micrometres = unit == "um" || unit == "µm" || unit == "μm";
      layer_um = micrometres ? given : given * 1000;
      if (layer_um > 1000) {
        throw InputError(source.path, place,
                         fmt::format("is {:g} mm; expected at most 1 mm", layer_um / 1000));
      }
    }
  };
  // Header lines of print files begin with ';': they count here.
  each_line(source.text, "#", take_line);
  if (exposure_s <= 0 || layer_um <= 0) {
    throw InputError(source.path, "",
                     fmt::format("has no {}; expected lines such as 'LayerHeight = 0.05' and "
                                 "'ExposureTime = 2.5'",
                                 exposure_s <= 0 ? "exposure time" : "layer height"));
  }
  draft.name =
      options.name.empty()
          ? stable_name_of(draft.product.empty() ? source.file.substr(0, source.file.rfind('.'))
                                                 : draft.product)
          : options.name;
  draft.assumptions.emplace_back(
      "Times without a unit are seconds, layer heights without a unit millimetres.");
  const std::string problem = resin_of_exposures({{layer_um, exposure_s}}, options, draft);
  if (!problem.empty()) throw InputError(source.path, "", problem);
  return {finish_resin(draft, source, "uvtools")};
}

}  // namespace slicecorr::resins
