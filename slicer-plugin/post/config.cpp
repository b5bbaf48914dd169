// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "post/config.hpp"

#include <fmt/format.h>
#include <fnmatch.h>

#include <algorithm>
#include <array>
#include <cstdlib>
#include <filesystem>

#include "slicecorr/error.hpp"
#include "slicecorr/load_display.hpp"
#include "support/text/nearest.hpp"
#include "support/toml/toml_table.hpp"

namespace slicecorr::post {

namespace fs = std::filesystem;

namespace {

constexpr std::array<std::string_view, 5> kMatchers = {"name", "folder", "file", "printer_profile",
                                                       "material_profile"};

/// Keys are written with _ in TOML files, options with -.
std::string option_name(std::string key) {
  std::replace(key.begin(), key.end(), '_', '-');
  return key;
}
std::string key_name(std::string option) {
  std::replace(option.begin(), option.end(), '-', '_');
  return option;
}

std::string home_expanded(const std::string& pattern) {
  const char* const home = std::getenv("HOME");
  const bool at_home = pattern == "~" || pattern.rfind("~/", 0) == 0;
  return at_home && home ? home + pattern.substr(1) : pattern;
}

bool glob(const std::string& pattern, const std::string& text, int flags = 0) {
  return ::fnmatch(pattern.c_str(), text.c_str(), flags) == 0;
}

bool folder_matches(const std::string& given, const fs::path& file) {
  std::string pattern = home_expanded(given);
  while (pattern.size() > 1 && pattern.back() == '/') pattern.pop_back();
  const bool whole = pattern.find('/') != std::string::npos;
  for (fs::path folder = file.parent_path(); !folder.empty(); folder = folder.parent_path()) {
    if (glob(pattern, whole ? folder.string() : folder.filename().string())) return true;
    if (folder == folder.parent_path()) break;
  }
  return false;
}

class Reader {
 public:
  Reader(const toml::table& root, const std::string& path) : root_(root), path_(path) {}

  Config read() {
    config_.path = path_;
    for (const auto& [key, node] : root_) {
      const std::string name(key.str());
      if (name == "default") {
        if (!node.is_table()) fail(node, name, "expected a table: [default]");
        read_values(*node.as_table(), false, config_.defaults);
      } else if (name == "rule") {
        read_rules(node);
      } else {
        unknown(node, name, {"default", "rule"});
      }
    }
    check_together({}, 0);
    for (const Rule& rule : config_.rules) check_together(rule.values, rule.line);
    return std::move(config_);
  }

 private:
  [[noreturn]] void fail(const toml::node& node, const std::string& key,
                         const std::string& message) const {
    throw InputError(path_, fmt::format("line {}: {}", node.source().begin.line, key), message);
  }
  [[noreturn]] void unknown(const toml::node& node, const std::string& key,
                            const std::vector<std::string_view>& known) const {
    const std::string near = nearest(key, known);
    fail(node, key,
         near.empty() ? "unknown key" : fmt::format("unknown key; did you mean '{}'?", near));
  }

  void read_rules(const toml::node& node) {
    const toml::array* const rules = node.as_array();
    if (rules == nullptr) fail(node, "rule", "expected tables: [[rule]]");
    for (const toml::node& each : *rules) {
      const toml::table* const table = each.as_table();
      if (table == nullptr) fail(each, "rule", "expected a table: [[rule]]");
      Rule rule;
      rule.line = table->source().begin.line;
      rule.name = fmt::format("rule {}", config_.rules.size() + 1);
      const auto text = [&](const char* key) -> std::optional<std::string> {
        const toml::node* const value = table->get(key);
        if (value == nullptr) return std::nullopt;
        if (!value->is_string() || (**value->as_string()).empty()) {
          fail(*value, key, "expected a text in quotes");
        }
        return **value->as_string();
      };
      if (const auto name = text("name")) rule.name = *name;
      rule.folder = text("folder");
      rule.file = text("file");
      rule.printer_profile = text("printer_profile");
      rule.material_profile = text("material_profile");
      if (rule.folder && rule.folder->find('/') != std::string::npos &&
          home_expanded(*rule.folder).front() != '/' && rule.folder->front() != '*') {
        fail(*table->get("folder"), "folder",
             fmt::format("is '{}'; expected a path from / or ~, or one name", *rule.folder));
      }
      if (rule.file && rule.file->find('/') != std::string::npos) {
        fail(*table->get("file"), "file", "is the name of a file; expected its folder in 'folder'");
      }
      if (!rule.folder && !rule.file && !rule.printer_profile && !rule.material_profile) {
        fail(each, "rule",
             "matches every file; expected folder, file, printer_profile or material_profile, or "
             "its settings in [default]");
      }
      read_values(*table, true, rule.values);
      config_.rules.push_back(std::move(rule));
    }
  }

  void read_values(const toml::table& table, bool in_rule, Values& values) const {
    for (const auto& [key, node] : table) {
      const std::string name(key.str());
      const bool matcher = std::find(kMatchers.begin(), kMatchers.end(), name) != kMatchers.end();
      if (in_rule && matcher) continue;
      const std::string option = option_name(name);
      const std::string value = value_text(node, name, option);
      if (values.contains(option)) fail(node, name, "is given twice, with _ and with -");
      try {
        settings_of({{option, value}});
      } catch (const InputError& e) {
        check_known(node, name, in_rule);
        fail(node, name, e.what());
      }
      values[option] = value;
      check_definition(node, name, value);
    }
  }

  void check_known(const toml::node& node, const std::string& name, bool in_rule) const {
    CLI::App app;
    app.set_help_flag();
    PostSettings settings;
    settings.add_to(app);
    std::vector<std::string> known;
    if (in_rule) known.assign(kMatchers.begin(), kMatchers.end());
    for (const CLI::Option* option : app.get_options()) {
      known.push_back(key_name(option->get_lnames().front()));
    }
    if (std::find(known.begin(), known.end(), key_name(name)) != known.end()) return;
    unknown(node, name, {known.begin(), known.end()});
  }

  std::string value_text(const toml::node& node, const std::string& key,
                         const std::string& option) const {
    if (const auto* text = node.as_string()) {
      const fs::path value = **text;
      // A definition beside the config file is meant from there, wherever the program runs.
      const bool file = (option == "printer" || option == "resin") && value.extension() == ".toml";
      return file ? (fs::path(path_).parent_path() / home_expanded(value)).string()
                  : value.string();
    }
    if (const auto* whole = node.as_integer()) return fmt::format("{}", **whole);
    if (const auto* number = node.as_floating_point()) return fmt::format("{}", **number);
    if (const auto* flag = node.as_boolean()) {
      if (option == "backup") return **flag ? "keep" : "no";
      if (option == "report") return **flag ? "html" : "no";
      return **flag ? "true" : "false";
    }
    fail(node, key, "expected a number, a text or true or false");
  }

  void check_definition(const toml::node& node, const std::string& key,
                        const std::string& value) const {
    try {
      if (key == "printer") load_display(value);  // its light may be assumed
      if (key == "resin") load_resin(value);
    } catch (const InputError& e) {
      fail(node, key, e.what());
    }
  }

  /// A rule may leave printer and resin to the archive's profiles; what it says must still go
  /// together.
  void check_together(const Values& rule, unsigned line) const {
    const PostSettings settings = settings_of(over(config_.defaults, rule));
    if (settings.setup.printer.empty() || settings.setup.resin.empty()) return;
    StackInfo times;
    times.exposure_s = 1;
    try {
      cli::SetupOptions setup = settings.setup;
      if (setup.mode.empty()) setup.mode = setup.speed_mm_h > 0 ? "continuous" : "layerwise";
      setup.resolve(nullptr, &times);
    } catch (const InputError& e) {
      const unsigned at = line > 0 ? line : root_.get("default")->source().begin.line;
      throw InputError(path_, fmt::format("line {}", at), e.what());
    }
  }

  const toml::table& root_;
  const std::string& path_;
  Config config_;
};

}  // namespace

bool matches(const Rule& rule, const Subject& subject) {
  const fs::path path = subject.path;
  const auto fits = [](const std::optional<std::string>& pattern, const std::string& text,
                       int flags) { return !pattern || glob(*pattern, text, flags); };
  return fits(rule.file, path.filename().string(), 0) &&
         fits(rule.printer_profile, subject.profiles.printer, FNM_CASEFOLD) &&
         fits(rule.material_profile, subject.profiles.material, FNM_CASEFOLD) &&
         (!rule.folder || folder_matches(*rule.folder, path));
}

const Rule* Config::match(const Subject& subject) const {
  const auto found = std::find_if(rules.begin(), rules.end(),
                                  [&](const Rule& rule) { return matches(rule, subject); });
  return found == rules.end() ? nullptr : &*found;
}

Config parse_config(std::string_view text, const std::string& path) {
  const toml::table root = parse_toml(text, path);
  return Reader(root, path).read();
}

Config load_config(const std::string& path) {
  if (!path.empty()) return parse_config(read_text_file(path), path);
  const std::string folder = user_definition_folder();
  if (folder.empty()) return {};
  const std::string usual = folder + "/post.toml";
  std::error_code ec;
  if (!fs::exists(usual, ec)) return {};
  return parse_config(read_text_file(usual), usual);
}

}  // namespace slicecorr::post
