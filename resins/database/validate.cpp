// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Checks of a definition file. The parsers of the library stay the judges of values; what is here
// finds all that is wrong with a file at once, and what they let pass: unknown keys, and with
// check_meaning.cpp doses that contradict each other and files that are missing.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>

#include "database/checked_file.hpp"
#include "database/record_text.hpp"
#include "database/schema.hpp"
#include "slicecorr/beam_vat.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/unmeasured_light.hpp"
#include "support/text/nearest.hpp"
#include "support/toml/toml_table.hpp"

namespace slicecorr::resins {

namespace {

namespace fs = std::filesystem;

class Checker : private CheckedFile {
 public:
  Checker(const std::string& its_text, std::string its_path, std::string its_kind)
      : CheckedFile{its_text, std::move(its_path), std::move(its_kind), {}, {}} {}

  std::vector<Finding> run() {
    if (text.find('\0') != std::string::npos) {
      add(0, "", "is no text: it holds zero bytes; expected TOML");
      return std::move(found);
    }
    TomlFault fault;
    auto table = try_toml(text, path, &fault);
    if (!table) {
      add(fault.line, "", "is not TOML: " + fault.what);
      return std::move(found);
    }
    root = std::move(*table);
    if (!decide_kind()) return std::move(found);
    check_name();
    for (const UnknownKey& u : unknown_keys(text, kind)) {
      const bool nothing_near = u.message == "unknown key" || u.message == "unknown table";
      add(static_cast<std::size_t>(u.line), u.key,
          nothing_near ? u.message + "; validate --schema lists those known" : u.message);
    }
    for (const auto& [key, node] : root) check_root(key, node);
    for (const KeyRule& rule : definition_keys(kind)) check_required(rule);
    if (kind == "resin") {
      check_resin(*this);
    } else {
      check_printer(*this);
    }
    ask_parser();
    std::stable_sort(found.begin(), found.end(),
                     [](const Finding& a, const Finding& b) { return a.line < b.line; });
    return std::move(found);
  }

 private:
  bool decide_kind() {
    std::string is = root.contains("cure")                                         ? "resin"
                     : root.contains("display")                                    ? "printer"
                     : root.contains("inhibition") || root.contains("composition") ? "resin"
                     : root.contains("blue") || root.contains("stage") || root.contains("vial")
                         ? "printer"
                         : kind;
    if (is.empty()) {
      add(0, "", "is neither a resin (with a table [cure]) nor a printer (with [display])");
      return false;
    }
    if (!kind.empty() && kind != is) {
      add(0, "", fmt::format("is a {}; expected a {}", is, kind));
      return false;
    }
    kind = is;
    return true;
  }

  void check_name() {
    const std::string stem = fs::path(path).stem().string();
    const toml::node* node = root.get("name");
    if (!node) {
      add(0, "name", fmt::format("missing; expected name = \"{}\"", stem), true);
    } else if (const auto* value = node->as_string()) {
      const std::string& name = **value;
      if (!is_stable_name(name)) {
        add(node->source().begin.line, "name",
            fmt::format("is '{}'; expected at most 100 lower case letters, digits, '-', '.', '_', "
                        "a letter or digit first",
                        name));
      } else if (name != stem) {
        add(node->source().begin.line, "name",
            fmt::format("is '{}', but the file is {}.toml; expected the same", name, stem));
      }
    }
  }

  /// Values of the keys that are known.
  void check_root(const toml::key& key, const toml::node& node) {
    const std::string_view name = key.str();
    const auto rules = definition_keys(kind);
    const bool holds_tables = std::any_of(rules.begin(), rules.end(), [&](const KeyRule& rule) {
      return rule.table.starts_with(name) && rule.table.substr(name.size()).starts_with('.');
    });
    if (holds_tables && node.is_table()) {
      for (const auto& [inner, below] : *node.as_table()) {
        check_table(full_key(name, inner.str()), inner, below);
      }
      return;
    }
    // "chemistry" is a word or a table.
    const KeyRule* rule = key_rule(kind, "", name);
    if (rule && !(is_table(name) && node.is_table())) {
      check_value(rule, "", name, node);
    } else {
      check_table(name, key, node);
    }
  }

  bool is_table(std::string_view name) const {
    const auto rules = definition_keys(kind);
    return std::any_of(rules.begin(), rules.end(), [&](const KeyRule& rule) {
      return !rule.table.empty() &&
             (rule.table == name || rule.table.substr(0, rule.table.find('.')) == name);
    });
  }

  void check_table(std::string_view name, const toml::key& key, const toml::node& node) {
    if (!is_table(name)) return;
    const toml::table* table = node.as_table();
    if (!table) {
      add(key.source().begin.line, std::string(name), "expected a table");
      return;
    }
    for (const auto& [word, value] : *table) {
      if (const KeyRule* rule = key_rule(kind, name, word.str())) {
        check_value(rule, name, word.str(), value);
      }
    }
  }

  void check_required(const KeyRule& rule) {
    if (!rule.required) return;
    const toml::table* t = table(rule.table);
    const bool table_required =
        rule.table == "cure" || rule.table == "display" || rule.table == "blue";
    if (!t) {
      const bool told = std::any_of(found.begin(), found.end(),
                                    [&](const Finding& f) { return f.key == rule.table; });
      if (table_required && !told) add(0, std::string(rule.table), "missing; expected a table");
    } else if (!t->get(rule.key)) {
      const std::string near = misspelt(rule.table, rule.key);
      if (near.empty()) {
        add(t->source().begin.line, full_key(rule.table, rule.key), "missing; it is required");
      }
    }
  }
  /// A key found unknown for which this one was offered: one complaint is enough.
  std::string misspelt(std::string_view in, std::string_view key) const {
    for (const Finding& f : found) {
      if (f.key.starts_with(full_key(in, "")) && f.message.ends_with(fmt::format("'{}'?", key))) {
        return f.key;
      }
    }
    return "";
  }

  void check_number(const KeyRule& r, const std::string& key, const toml::node& node) {
    const std::size_t line = node.source().begin.line;
    const auto value = node.is_number() ? node.value<double>() : std::nullopt;
    if (!value) {
      add(line, key, "expected a number");
    } else if (!std::isfinite(*value) || *value > r.high ||
               (r.low_counts ? *value < r.low : *value <= r.low)) {
      add(line, key,
          fmt::format("is {:g}; expected a number {} {:g} and at most {:g}", *value,
                      r.low_counts ? "of at least" : "above", r.low, r.high));
    }
  }

  void check_choice(const KeyRule& r, const std::string& key, const toml::node& node) {
    const std::size_t line = node.source().begin.line;
    const auto* value = node.as_string();
    std::vector<std::string_view> words;
    for (std::size_t at = 0; at <= r.choices.size();) {
      const std::size_t end = std::min(r.choices.find('|', at), r.choices.size());
      words.push_back(r.choices.substr(at, end - at));
      at = end + 1;
    }
    std::string list;
    for (const auto word : words) list += fmt::format("{}\"{}\"", list.empty() ? "" : ", ", word);
    if (!value) {
      add(line, key, fmt::format("expected one of {}", list));
    } else if (std::find(words.begin(), words.end(), **value) == words.end()) {
      add(line, key, fmt::format("is '{}'; expected one of {}", **value, list));
    }
  }

  void check_calibration(const std::string& key, const toml::node& node) {
    const std::size_t line = node.source().begin.line;
    if (node.is_string()) return;  // the parser reads the file
    const auto* points = node.as_array();
    if (!points) {
      add(line, key, "expected [[grey level, mW/cm²], ...] or a .csv file");
      return;
    }
    double level = -1, intensity = -1;
    std::size_t number = 0;
    for (const auto& element : *points) {
      ++number;
      const std::size_t at = element.source().begin.line;
      const auto* pair = element.as_array();
      const auto side = [&](std::size_t i) {
        const toml::node* n = pair && pair->size() == 2 ? pair->get(i) : nullptr;
        return n && n->is_number() ? n->value<double>() : std::nullopt;
      };
      const auto l = side(0), v = side(1);
      if (!l || !v) {
        add(at, key, fmt::format("point {}: expected a pair [grey level, mW/cm²]", number));
        continue;
      }
      if (!std::isfinite(*v) || *v < 0 || *v > 1e6) {
        add(at, key, fmt::format("point {}: {:g} mW/cm² is not from 0 to 1e6", number, *v));
      } else if (*v < intensity) {
        add(at, key,
            fmt::format("point {}: the curve must not fall, {:g} comes after {:g} mW/cm²", number,
                        *v, intensity));
      }
      if (number > 1 && *l <= level) {
        add(at, key,
            fmt::format("point {}: grey levels must rise, {:g} comes after {:g}", number, *l,
                        level));
      }
      level = *l;
      intensity = *v;
    }
  }

  void check_texts(const std::string& key, const toml::node& node) {
    const auto* list = node.as_array();
    // Tables have a semicolon between them.
    const auto text = [](const toml::node& n) {
      return n.is_string() && !n.as_string()->get().empty() &&
             n.as_string()->get().find(';') == std::string::npos;
    };
    if (!list || !std::all_of(list->begin(), list->end(), text)) {
      add(node.source().begin.line, key,
          "expected a list of texts without semicolons, [\"...\", \"...\"]");
    }
  }

  void check_notes(const std::string& key, const toml::node& node) {
    const auto plain = [](const toml::node& n) { return n.is_value(); };
    if (plain(node)) return;
    const auto* list = node.as_array();
    if (!list || !std::all_of(list->begin(), list->end(), plain)) {
      add(node.source().begin.line, key, "expected a text, a number, a date or a list of texts");
    }
  }

  void check_value(const KeyRule* r, std::string_view in, std::string_view name,
                   const toml::node& node) {
    const std::string key = full_key(in, name);
    const std::size_t line = node.source().begin.line;
    switch (r->type) {
      case KeyType::text:
      case KeyType::file:
        if (!node.is_string()) add(line, key, "expected a text in quotes");
        break;
      case KeyType::texts:
        check_texts(key, node);
        break;
      case KeyType::number:
        check_number(*r, key, node);
        break;
      case KeyType::whole:
        if (const auto* value = node.as_integer(); !value) {
          add(line, key, "expected a whole number");
        } else if (**value < static_cast<std::int64_t>(r->low) ||
                   **value > static_cast<std::int64_t>(r->high)) {
          add(line, key, fmt::format("is {}; expected {:g} to {:g}", **value, r->low, r->high));
        }
        break;
      case KeyType::choice:
        check_choice(*r, key, node);
        break;
      case KeyType::base: {
        const bool ten = node.is_integer() && **node.as_integer() == 10;
        const bool word =
            node.is_string() && (**node.as_string() == "e" || **node.as_string() == "10");
        if (!ten && !word) add(line, key, "expected 10 or \"e\"");
        break;
      }
      case KeyType::pixel:
        if (const auto* pair = node.as_array()) {
          if (pair->size() != 2) {
            add(line, key, "expected a number or [x, y]");
          } else {
            for (const auto& side : *pair) check_number(*r, key, side);
          }
        } else {
          check_number(*r, key, node);
        }
        break;
      case KeyType::calibration:
        check_calibration(key, node);
        break;
      case KeyType::spread:
        if (!node.is_array() && !node.is_string()) {
          add(line, key, "expected [[sigma_um, weight], ...] or the name of a PNG file");
        }
        break;
      case KeyType::mirror:
        if (!node.is_boolean()) check_choice(*r, key, node);
        break;
      case KeyType::truth:
        if (!node.is_boolean()) add(line, key, "expected true or false");
        break;
      case KeyType::notes:
        check_notes(key, node);
        break;
      case KeyType::parts:
        check_number(*r, key, node);
        break;
      case KeyType::anything:
        break;
    }
  }

  /// What the parser says, unless it has been said. Its message is "FILE: line N: KEY: text".
  void ask_parser() {
    try {
      if (kind == "resin") {
        parse_resin(text, path);
      } else {
        parse_beam_vat(text, path, parse_display(text, path));
      }
    } catch (const Error& e) {
      std::string message = e.what();
      int line = 0;
      std::string key;
      const std::string head = path + ": line ";
      if (message.starts_with(head)) {
        std::size_t end = 0;
        line = std::stoi(message.substr(head.size()), &end);
        const std::size_t begin = head.size() + end + 2;
        const std::size_t colon = message.find(": ", begin);
        if (colon != std::string::npos) {
          key = message.substr(begin, colon - begin);
          message.erase(0, colon + 2);
        }
      } else {
        key = kind == "printer" ? "calibration" : "";
      }
      const bool told = std::any_of(found.begin(), found.end(), [&](const Finding& f) {
        return !f.warning &&
               (f.key == key || (line > 0 && f.line == line) ||
                f.message.ends_with(fmt::format("'{}'?", key.substr(key.find_last_of('.') + 1))));
      });
      if (!told) add(line, key, message);
    }
  }
};

}  // namespace

std::string Finding::to_text() const {
  return fmt::format("{}:{}{} {}{}{}", file, line > 0 ? fmt::format("{}:", line) : "",
                     warning ? " warning:" : "", key, key.empty() ? "" : ": ", message);
}

std::vector<Finding> validate_text(const std::string& text, const std::string& path,
                                   std::string_view kind) {
  return Checker(text, path, std::string(kind)).run();
}

std::vector<Finding> validate_definition(const std::string& path) {
  const auto one = [&](const std::string& message) {
    return std::vector<Finding>{{path, 0, "", message, false}};
  };
  std::error_code ec;
  if (!fs::is_regular_file(path, ec)) return one("is not a file that can be read");
  const auto size = fs::file_size(path, ec);
  if (!ec && size > kMostDefinitionBytes) {
    return one(fmt::format("has {:.1f} MiB; expected a definition of at most {} MiB",
                           static_cast<double>(size) / (1U << 20), kMostDefinitionBytes >> 20));
  }
  try {
    return validate_text(read_text_file(path), path);
  } catch (const Error& e) {
    return one(e.what());
  }
}

}  // namespace slicecorr::resins
