// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Definitions that are handed in. The text is written anew, key by key as the schema lists them, so that
// nothing comes along that nobody looked at: no comments, no tables of one machine.
#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <iterator>
#include <optional>
#include <set>

#include "database/record_text.hpp"
#include "database/schema.hpp"
#include "database/toml_edit.hpp"
#include "exchange/personal.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/load_display.hpp"
#include "slicecorr/resins/exchange.hpp"
#include "slicecorr/resins/measurements.hpp"
#include "slicecorr/unmeasured_light.hpp"
#include "support/files/text_file.hpp"
#include "support/text/ascii.hpp"
#include "support/toml/toml_table.hpp"

namespace slicecorr::resins {

namespace {

namespace fs = std::filesystem;

/// Whether a text says a year.
bool says_a_year(const std::string& text) {
  for (std::size_t at = 0; at < text.size();) {
    std::size_t end = at;
    while (end < text.size() && is_digit(text[end])) ++end;
    if (end - at == 4 && text.compare(at, 2, "19") >= 0 && text.compare(at, 2, "20") <= 0) {
      return true;
    }
    at = std::max(end, at + 1);
  }
  return false;
}

std::string calibration_text(const std::vector<CalibrationPoint>& points) {
  std::string out;
  for (const CalibrationPoint& p : points) {
    out += fmt::format("{}[{}, {}]", out.empty() ? "" : ", ", p.level, p.intensity_mw_cm2);
  }
  return fmt::format("[{}]", out);
}

class Sharer {
 public:
  Sharer(const std::string& path, std::string name, const std::vector<std::string>& private_names)
      : path_(path),
        folder_(fs::path(path).parent_path()),
        name_(std::move(name)),
        private_(private_names) {}

  Shared run() {
    if (!name_.empty() && !is_stable_name(name_)) {
      throw InputError(
          fmt::format("'{}' is no name of a definition; expected at most 100 lower case "
                      "letters, digits, '-', '.', '_', a letter or digit first",
                      name_));
    }
    add_errors(validate_definition(path_));
    if (made_.wrong.empty()) write();
    if (!made_.wrong.empty()) return {"", {}, {}, std::move(made_.wrong)};
    return std::move(made_);
  }

 private:
  void write() {
    const std::string text = read_text_file(path_);
    kind_ = *kind_of_definition(path_);
    root_ = parse_toml(text, path_);
    if (name_.empty()) name_ = root_["name"].value_or(fs::path(path_).stem().string());
    if (kind_ == "printer") {
      printer_ = load_display(path_);
    } else if (!parse_resin(text, path_).tuned_with.empty()) {
      wrong("provenance.tuning",
            "says that the resin was tuned for the light of one printer; expected the resin as it "
            "was before, which its history has");
    }
    check_provenance();
    write_root();
    for (const std::string_view name : tables()) write_table(name);
    if (!made_.wrong.empty()) return;
    // What is handed in is checked as it stands, but for files that lie beside it later.
    std::vector<Finding> found = validate_text(made_.text, name_ + ".toml", kind_);
    std::erase_if(found, [](const Finding& f) { return f.key == "provenance.measurements"; });
    add_errors(found);
  }

  void add_errors(const std::vector<Finding>& found) {
    std::copy_if(found.begin(), found.end(), std::back_inserter(made_.wrong),
                 [](const Finding& f) { return !f.warning; });
  }
  void wrong(const std::string& key, const std::string& message) {
    made_.wrong.push_back({path_, 0, key, message, false});
  }

  const toml::table* table(std::string_view name) const { return table_at(root_, name); }
  std::string said(std::string_view in, std::string_view key) const {
    const toml::table* t = table(in);
    const toml::node* node = t ? t->get(key) : nullptr;
    return node ? std::string(trimmed(text_of_value(*node))) : std::string();
  }

  /// Who has the file alone must be able to judge it.
  void check_provenance() {
    const auto need = [&](const char* in, const char* key, const char* expected) {
      if (!said(in, key).empty()) return;
      wrong(*in ? fmt::format("{}.{}", in, key) : std::string(key),
            fmt::format("missing; expected {}", expected));
    };
    const bool printer = kind_ == "printer";
    const bool composed = !printer && table("composition");
    if (!composed) need("", "maker", printer ? "who makes the printer" : "who makes the resin");
    if (!composed) {
      need("", "product",
           printer ? "the maker's name for it" : "what the bottle says, or a table [composition]");
    }
    need("provenance", "source",
         "where the figures come from, such as \"measured with films\" or a paper");
    if (!printer) {
      need("cure", "wavelength_nm", "the wavelength of the light that the resin was measured in");
    }
    if (printer && !light_is_measured(*printer_)) return;
    need("provenance", "measured_with",
         "what it was measured with, such as \"calipers, 0.01 mm\" or a power meter's type");
    need("provenance", "measurements",
         "how many of what, or the names of .csv files beside the file");
    if (!says_a_year(said("provenance", "date"))) {
      wrong("provenance.date", "says no year; expected when it was measured, such as \"2026\"");
    }
  }

  std::vector<std::string_view> tables() const {
    std::vector<std::string_view> names;
    for (const KeyRule& rule : definition_keys(kind_)) {
      const bool is_new = std::find(names.begin(), names.end(), rule.table) == names.end();
      if (!rule.table.empty() && is_new) names.push_back(rule.table);
    }
    return names;
  }

  void write_root() {
    made_.text = fmt::format("name = {}\n", toml_text(name_));
    check_words("name", name_, true);
    for (const KeyRule& rule : definition_keys(kind_)) {
      if (!rule.table.empty() && !rule.also_at_top) continue;
      const toml::node* node = root_.get(rule.key);
      // Versions count the changes of one folder; "chemistry" may be a table.
      if (!node || rule.key == "name" || rule.key == "version" || node->is_table()) continue;
      write_key("", std::string(rule.key), rule, *node);
    }
  }

  void write_table(std::string_view name) {
    const toml::table* t = table(name);
    if (!t) return;
    if (name == "modbus") {
      made_.left_out.emplace_back("[modbus]: how your computer reaches your machine");
      return;
    }
    made_.text += fmt::format("\n[{}]\n", name);
    for (const KeyRule& rule : definition_keys(kind_)) {
      if (rule.table != name) continue;
      for (const auto& [key, node] : *t) {
        if (rule.key == "*" || rule.key == key.str()) {
          write_key(name, std::string(key.str()), rule, node);
        }
      }
    }
  }

  /// Pictures and tables that tell of one display or stage.
  bool is_of_one_machine(const KeyRule& rule) const {
    const auto* spread = table(rule.table);
    const toml::node* picture = spread ? spread->get("spread") : nullptr;
    return rule.type == KeyType::file || rule.key.starts_with("flat_field") ||
           (picture && picture->is_string() && rule.key.starts_with("spread"));
  }

  void write_key(std::string_view in, const std::string& key, const KeyRule& rule,
                 const toml::node& node) {
    const std::string full = in.empty() ? key : fmt::format("{}.{}", in, key);
    if (kind_ == "printer" && is_of_one_machine(rule)) {
      made_.left_out.push_back(
          fmt::format("{}: a picture or table of your machine alone, or what belongs to it", full));
      return;
    }
    std::string value;
    if (full == "provenance.measurements" && kind_ == "resin") {
      value = measurements(node);
    } else if (rule.type == KeyType::calibration && node.is_string() &&
               **node.as_string() != kToBeMeasured) {
      value = calibration_text(in == "uv" ? printer_->uv->calibration : printer_->calibration);
    } else {
      value = value_text(full, node);
    }
    const bool bare = std::all_of(key.begin(), key.end(), [](char c) {
      return (lower_case(c) >= 'a' && lower_case(c) <= 'z') || is_digit(c) || c == '_' || c == '-';
    });
    check_words(full, key, true);
    made_.text += fmt::format("{} = {}\n", bare ? key : toml_text(key), value);
  }

  /// A value as TOML; its texts are looked at.
  std::string value_text(const std::string& key, const toml::node& node) {
    if (const auto* text = node.as_string()) {
      // What a maker calls a product may be somebody's name, too.
      static const std::set<std::string> of_makers = {"maker",   "product", "chemistry",
                                                      "aliases", "tags",    "colour"};
      check_words(key, **text, !of_makers.contains(key));
      return toml_text(**text);
    }
    if (const auto* list = node.as_array()) {
      std::string out;
      for (const auto& element : *list) {
        out += (out.empty() ? "" : ", ") + value_text(key, element);
      }
      return fmt::format("[{}]", out);
    }
    // The shortest text that is the same number.
    if (const auto* number = node.as_floating_point()) {
      std::string out = fmt::format("{}", **number);
      if (out.find_first_not_of("-0123456789") == std::string::npos) out += ".0";
      return out;
    }
    return text_of_value(node);
  }

  void check_words(const std::string& key, const std::string& text, bool names) {
    const std::string found = path_or_address_in(text);
    if (!found.empty()) {
      wrong(key, fmt::format("holds {}; expected it in other words", found));
      return;
    }
    const std::string name = names ? name_in(text, private_) : std::string();
    if (!name.empty()) {
      wrong(key, fmt::format("holds '{}', the name of a user or of this computer; expected it in "
                             "other words",
                             name));
    }
  }

  /// What is measured goes along as numbers, under names that follow from the definition's.
  std::string measurements(const toml::node& node) {
    std::vector<std::string> names;
    const auto add = [&](const std::string& name) {
      if (!name.ends_with(".csv")) {
        check_words("provenance.measurements", name, true);
        names.push_back(name);
        return;
      }
      const Measurements read = read_measurements({(folder_ / name).string()});
      for (const std::string& warning : read.warnings) {
        made_.left_out.push_back(
            fmt::format("{}: only what was read; {}", fs::path(name).filename().string(), warning));
      }
      const std::size_t n = made_.attachments.size() + 1;
      const std::string stem = n == 1 ? name_ : fmt::format("{}-{}", name_, n);
      made_.attachments.push_back(
          {"provenance", "measurements", stem, ".csv", measurements_as_csv(read)});
      names.push_back(stem + ".csv");
    };
    if (const auto* list = node.as_array()) {
      for (const auto& element : *list) add(text_of_value(element));
    } else {
      add(text_of_value(node));
    }
    return names.size() == 1 && !names.front().ends_with(".csv") ? toml_text(names.front())
                                                                 : toml_texts(names);
  }

  std::string path_;
  fs::path folder_;
  std::string name_;
  const std::vector<std::string>& private_;
  std::string kind_;
  toml::table root_;
  std::optional<Printer> printer_;
  Shared made_;
};

}  // namespace

Shared share_definition(const std::string& path, const std::string& name,
                        const std::vector<std::string>& private_names) {
  return Sharer(path, name, private_names).run();
}

}  // namespace slicecorr::resins
