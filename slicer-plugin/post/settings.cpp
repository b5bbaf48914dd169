// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "post/settings.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <set>
#include <vector>

#include "programs/common/mesh_options.hpp"
#include "programs/common/program.hpp"
#include "slicecorr/error.hpp"
#include "support/text/nearest.hpp"

namespace slicecorr::post {

namespace {

/// Options of which a new one puts aside all that was said before.
struct Group {
  std::set<std::string> leading;  ///< each of them says it anew
  std::set<std::string> all;
};
const std::vector<Group>& groups() {
  static const std::vector<Group> list = {
      {{"mode", "speed-mm-h", "exposure-s", "layer-exposure-s"},
       {"mode", "speed-mm-h", "slice-speed-mm-h", "slice-lamps", "ramp", "ramp-mm", "exposure-s",
        "bottom-exposure-s", "bottom-layers", "fade-layers", "layer-exposure-s"}},
      {{"uv-mw-cm2", "dead-zone-um", "even-dead-zone"},
       {"uv-mw-cm2", "dead-zone-um", "uv-schedule", "even-dead-zone"}},
      {{"dc-mj-cm3", "dose-factor"}, {"dc-mj-cm3", "dose-factor"}}};
  return list;
}

std::vector<std::string> names_in(const CLI::App& app) {
  std::vector<std::string> names;
  for (const CLI::Option* option : app.get_options()) {
    if (!option->get_lnames().empty()) names.push_back(option->get_lnames().front());
  }
  return names;
}

/// Names of all settings.
const std::vector<std::string>& setting_names() {
  static const std::vector<std::string> names = [] {
    CLI::App app;
    app.set_help_flag();
    PostSettings settings;
    settings.add_to(app);
    return names_in(app);
  }();
  return names;
}

}  // namespace

void PostSettings::add_to(CLI::App& app) {
  setup.add_to(app, false, true);
  app.get_option("--mode")->description(
      "How the printer exposes: standing still for each layer, or while the stage moves [layer by "
      "layer, as the archive says; continuous with --speed-mm-h]");
  app.add_option("--layer-um", layer_um, "Layer height of archives that do not say it, 1 to 1000")
      ->check(cli::number_in(1, 1000));
  app.add_flag(
         "--backup{keep}", backup,
         "Keep the slicer's file beside as FILE.orig. One that is already there must hold the "
         "same; with --backup=replace it gives way")
      ->check(CLI::IsMember({"keep", "replace", "no"}));
  app.add_flag("--report{html}", report,
               "Write a report beside the file: FILE.html; --report=json writes the figures, "
               "--report=both the two")
      ->check(CLI::IsMember({"html", "json", "both", "no"}));
  app.add_flag("--leave-alone", leave_alone, "Correct nothing: for rules");
}

Values given_on(const CLI::App& app) {
  Values values;
  for (const std::string& name : setting_names()) {
    const CLI::Option* const option = app.get_option("--" + name);
    if (option->count() > 0) values[name] = option->results().back();
  }
  return values;
}

std::vector<std::string> part_options_on(const CLI::App& app) {
  CLI::App of_parts;
  of_parts.set_help_flag();
  std::vector<std::string> files;
  cli::add_part_inside_to(of_parts, files);
  cli::MeshOptions meshes;
  meshes.add_turns_to(of_parts);
  std::vector<std::string> options;
  for (const std::string& name : names_in(of_parts)) {
    const CLI::Option* const option = app.get_option("--" + name);
    if (option->count() == 0) continue;
    const std::vector<std::string>& said = option->results();
    if (option->get_delimiter() != '\0') {
      options.push_back(fmt::format("--{}={}", name, fmt::join(said, ",")));
      continue;
    }
    for (const std::string& value : said) options.push_back(fmt::format("--{}={}", name, value));
  }
  return options;
}

Values over(Values low, const Values& high) {
  for (const Group& group : groups()) {
    const bool anew = std::any_of(group.leading.begin(), group.leading.end(),
                                  [&](const std::string& name) { return high.contains(name); });
    if (!anew) continue;
    for (const std::string& name : group.all) low.erase(name);
  }
  for (const auto& [name, value] : high) low[name] = value;
  return low;
}

PostSettings settings_of(const Values& values) {
  PostSettings settings;
  CLI::App app;
  app.set_help_flag();
  settings.add_to(app);
  std::vector<std::string> arguments;
  for (const auto& [name, value] : values) {
    const auto& known = setting_names();
    if (std::find(known.begin(), known.end(), name) == known.end()) {
      const std::vector<std::string_view> words(known.begin(), known.end());
      const std::string near = nearest(name, words);
      throw InputError(fmt::format("'{}' is no setting{}", name,
                                   near.empty() ? "" : fmt::format("; did you mean '{}'?", near)));
    }
    arguments.push_back(fmt::format("--{}={}", name, value));
  }
  std::reverse(arguments.begin(), arguments.end());  // as the parser wants them
  try {
    app.parse(arguments);
  } catch (const CLI::ParseError& e) {
    throw InputError(e.what());
  }
  if (settings.backup == "no") settings.backup.clear();
  if (settings.report == "no") settings.report.clear();
  return settings;
}

}  // namespace slicecorr::post
