// Checks of a definition file. The parsers of the library stay the judges of values; what is here
// finds all that is wrong with a file at once, and what they let pass: unknown keys, doses that
// contradict each other, files that are missing.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <optional>

#include "base/nearest.hpp"
#include "database/flat_field.hpp"
#include "database/record_text.hpp"
#include "database/schema.hpp"
#include "process/toml_table.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/resins/measurements.hpp"

namespace slicecorr::resins {

namespace {

namespace fs = std::filesystem;

class Checker {
 public:
  Checker(const std::string& text, std::string path, std::string kind)
      : text_(text), path_(std::move(path)), kind_(std::move(kind)) {}

  std::vector<Finding> run() {
    if (text_.find('\0') != std::string::npos) {
      add(0, "", "is no text: it holds zero bytes; expected TOML");
      return std::move(found_);
    }
    try {
      root_ = toml::parse(text_, path_);
    } catch (const toml::parse_error& e) {
      add(e.source().begin.line, "", fmt::format("is not TOML: {}", e.description()));
      return std::move(found_);
    }
    if (!decide_kind()) return std::move(found_);
    check_name();
    for (const auto& [key, node] : root_) check_root(key, node);
    for (const KeyRule& rule : schema(kind_)) check_required(rule);
    if (kind_ == "resin") {
      check_doses();
      check_composition();
      check_measurements();
    } else {
      check_flat_field();
      check_projector();
    }
    ask_parser();
    std::stable_sort(found_.begin(), found_.end(),
                     [](const Finding& a, const Finding& b) { return a.line < b.line; });
    return std::move(found_);
  }

 private:
  void add(std::size_t line, const std::string& key, const std::string& message,
           bool warning = false) {
    found_.push_back({path_, static_cast<int>(line), key, message, warning});
  }
  static std::string full(std::string_view table, std::string_view key) {
    return table.empty() ? std::string(key) : fmt::format("{}.{}", table, key);
  }
  /// `name` may be that of a table in a table: "lamps.blue".
  const toml::table* table(std::string_view name) const {
    const toml::table* at = &root_;
    while (at && !name.empty()) {
      const std::size_t dot = name.find('.');
      const toml::node* node = at->get(name.substr(0, dot));
      at = node ? node->as_table() : nullptr;
      name = dot == std::string_view::npos ? "" : name.substr(dot + 1);
    }
    return at;
  }
  std::optional<double> number(std::string_view in, std::string_view key) const {
    const toml::table* t = table(in);
    const toml::node* node = t ? t->get(key) : nullptr;
    return node && node->is_number() ? node->value<double>() : std::nullopt;
  }
  std::size_t line_of(std::string_view in, std::string_view key) const {
    const toml::table* t = table(in);
    const toml::node* node = t ? t->get(key) : nullptr;
    return node ? node->source().begin.line : t ? t->source().begin.line : 0;
  }

  bool decide_kind() {
    std::string is = root_.contains("cure")                                          ? "resin"
                     : root_.contains("display")                                     ? "printer"
                     : root_.contains("inhibition") || root_.contains("composition") ? "resin"
                     : root_.contains("blue") || root_.contains("stage")             ? "printer"
                                                                                     : kind_;
    if (is.empty()) {
      add(0, "", "is neither a resin (with a table [cure]) nor a printer (with [display])");
      return false;
    }
    if (!kind_.empty() && kind_ != is) {
      add(0, "", fmt::format("is a {}; expected a {}", is, kind_));
      return false;
    }
    kind_ = is;
    return true;
  }

  void check_name() {
    const std::string stem = fs::path(path_).stem().string();
    const toml::node* node = root_.get("name");
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

  void check_root(const toml::key& key, const toml::node& node) {
    std::vector<std::string_view> tables, keys;
    for (const KeyRule& rule : schema(kind_)) {
      auto& list = rule.table.empty() ? keys : tables;
      const std::string_view word =
          rule.table.empty() ? rule.key : rule.table.substr(0, rule.table.find('.'));
      if (std::find(list.begin(), list.end(), word) == list.end()) list.push_back(word);
    }
    const std::string_view name = key.str();
    if (holds_tables(name) && node.is_table()) {
      check_inner_tables(name, *node.as_table());
      return;
    }
    const bool is_table = std::find(tables.begin(), tables.end(), name) != tables.end();
    const bool is_key = std::find(keys.begin(), keys.end(), name) != keys.end();
    if (!is_table && !is_key) {
      const std::string near = nearest(name, node.is_table() ? tables : keys);
      // A key of some table that was written before the table's head.
      std::string elsewhere;
      for (const KeyRule& rule : schema(kind_)) {
        if (rule.key == name && !node.is_table()) elsewhere = rule.table;
      }
      add(key.source().begin.line, std::string(name),
          elsewhere.empty()
              ? unknown(node.is_table() ? "table" : "key", near)
              : fmt::format("stands outside of its table; expected it under [{}]", elsewhere));
      return;
    }
    if (is_key) {
      check_value(rule_of("", name), "", name, node);
    } else if (const toml::table* t = node.as_table()) {
      check_table(name, *t);
    } else {
      add(key.source().begin.line, std::string(name), "expected a table");
    }
  }

  /// Whether the tables of the schema lie in one of this name: "lamps".
  bool holds_tables(std::string_view name) const {
    const auto rules = schema(kind_);
    return std::any_of(rules.begin(), rules.end(), [&](const KeyRule& rule) {
      return rule.table.starts_with(name) && rule.table.substr(name.size()).starts_with('.');
    });
  }
  void check_inner_tables(std::string_view name, const toml::table& outer) {
    std::vector<std::string_view> inner;
    for (const KeyRule& rule : schema(kind_)) {
      if (rule.table.starts_with(name) && rule.table.size() > name.size()) {
        const std::string_view word = rule.table.substr(name.size() + 1);
        if (std::find(inner.begin(), inner.end(), word) == inner.end()) inner.push_back(word);
      }
    }
    for (const auto& [key, node] : outer) {
      const bool known = std::find(inner.begin(), inner.end(), key.str()) != inner.end();
      if (!known) {
        add(key.source().begin.line, full(name, key.str()),
            unknown("table", nearest(key.str(), inner)));
      } else if (!node.is_table()) {
        add(key.source().begin.line, full(name, key.str()), "expected a table");
      } else {
        check_table(full(name, key.str()), *node.as_table());
      }
    }
  }

  static std::string unknown(const char* what, const std::string& near) {
    return fmt::format("unknown {}{}", what,
                       near.empty() ? "; validate --schema lists those known"
                                    : fmt::format("; did you mean '{}'?", near));
  }

  const KeyRule* rule_of(std::string_view in, std::string_view key) const {
    for (const KeyRule& rule : schema(kind_)) {
      if (rule.table == in && (rule.key == key || rule.key == "*")) return &rule;
    }
    return nullptr;
  }

  void check_table(std::string_view name, const toml::table& t) {
    std::vector<std::string_view> keys;
    for (const KeyRule& rule : schema(kind_)) {
      if (rule.table == name) keys.push_back(rule.key);
    }
    for (const auto& [key, node] : t) {
      if (const KeyRule* rule = rule_of(name, key.str())) {
        check_value(rule, name, key.str(), node);
      } else {
        add(key.source().begin.line, full(name, key.str()),
            unknown("key", nearest(key.str(), keys)));
      }
    }
  }

  void check_required(const KeyRule& rule) {
    if (!rule.required) return;
    const toml::table* t = table(rule.table);
    const bool table_required =
        rule.table == "cure" || rule.table == "display" || rule.table == "blue";
    if (!t) {
      const bool told = std::any_of(found_.begin(), found_.end(),
                                    [&](const Finding& f) { return f.key == rule.table; });
      if (table_required && !told) add(0, std::string(rule.table), "missing; expected a table");
    } else if (!t->get(rule.key)) {
      const std::string near = misspelt(rule.table, rule.key);
      if (near.empty()) {
        add(t->source().begin.line, full(rule.table, rule.key), "missing; it is required");
      }
    }
  }
  /// A key found unknown for which this one was offered: one complaint is enough.
  std::string misspelt(std::string_view in, std::string_view key) const {
    for (const Finding& f : found_) {
      if (f.key.starts_with(full(in, "")) && f.message.ends_with(fmt::format("'{}'?", key))) {
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
    const std::string key = full(in, name);
    const std::size_t line = node.source().begin.line;
    switch (r->type) {
      case KeyType::text:
      case KeyType::file:
        if (!node.is_string()) add(line, key, "expected a text in quotes");
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
      case KeyType::mirror:
        if (!node.is_boolean()) check_choice(*r, key, node);
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

  void check_doses() {
    const auto gel3 = number("cure", "gel_dose_mj_cm3"), gel2 = number("cure", "gel_dose_mj_cm2");
    const auto aim3 = number("cure", "critical_dose_mj_cm3"),
               aim2 = number("cure", "critical_dose_mj_cm2");
    const auto factor = number("cure", "dose_factor"),
               prime = number("cure", "critical_dose_prime");
    const double m = number("cure", "m").value_or(1.0);
    if (gel3 && gel2) {
      add(line_of("cure", "gel_dose_mj_cm2"), "cure.gel_dose_mj_cm2",
          "is given beside gel_dose_mj_cm3; expected one of them");
    }
    if (aim3 && aim2) {
      add(line_of("cure", "critical_dose_mj_cm2"), "cure.critical_dose_mj_cm2",
          "is given beside critical_dose_mj_cm3; expected one of them");
    }
    const bool areal = aim2 && !aim3;
    const std::string aim_key = areal ? "critical_dose_mj_cm2" : "critical_dose_mj_cm3";
    if (factor && *factor < 1) {
      add(line_of("cure", "dose_factor"), "cure.dose_factor",
          fmt::format("is {:g}: correction would aim below the gel dose", *factor), true);
    }
    if (m != 1.0) {
      for (const char* key :
           {"gel_dose_mj_cm3", "gel_dose_mj_cm2", "critical_dose_mj_cm3", "critical_dose_mj_cm2"}) {
        if (number("cure", key)) {
          add(line_of("cure", key), full("cure", key),
              fmt::format("does not count: with m = {:g} a dose is critical_dose_prime", m), true);
        }
      }
      return;
    }
    const toml::table* cure = table("cure");
    const toml::node* model = cure ? cure->get("model") : nullptr;
    const bool kinetic = model && model->value_or(std::string()) == "kinetic";
    if (prime && !kinetic) {
      add(line_of("cure", "critical_dose_prime"), "cure.critical_dose_prime",
          "does not count: it belongs to model = \"kinetic\"", true);
    }
    if (prime && kinetic && (aim3 || aim2)) {
      add(line_of("cure", "critical_dose_prime"), "cure.critical_dose_prime",
          fmt::format("does not count beside {}", aim_key), true);
    }
    const auto base_e = height_e();
    if (!(aim3 || aim2) || !base_e) return;
    const double aim = aim3 ? *aim3 : *aim2 / (*base_e * 1e-4);
    const auto gel = gel3 ? gel3 : gel2 ? std::optional(*gel2 / (*base_e * 1e-4)) : std::nullopt;
    if (gel && *gel > aim) {
      add(line_of("cure", aim_key), full("cure", aim_key),
          fmt::format("is {:g} mJ/cm³, below the gel dose of {:g} mJ/cm³: nothing would gel", aim,
                      *gel));
    } else if (gel && factor && std::abs(aim / (*gel * *factor) - 1) > 0.01) {
      add(line_of("cure", aim_key), full("cure", aim_key),
          fmt::format("is {:g} mJ/cm³, but gel dose times dose_factor is {:g}; expected one of "
                      "them, or the same",
                      aim, *gel * *factor));
    } else if (!gel && factor) {
      add(line_of("cure", "dose_factor"), "cure.dose_factor",
          fmt::format("does not count beside {} alone", aim_key), true);
    }
  }

  std::optional<double> height_e() const {
    const auto height = number("cure", "absorbance_height_um");
    const toml::table* cure = table("cure");
    const toml::node* base = cure ? cure->get("absorbance_base") : nullptr;
    if (!height || !(*height > 0) || !base) return std::nullopt;
    return base->is_string() && **base->as_string() == "e" ? *height
                                                           : units::height_e_from_10(*height);
  }

  void check_composition() {
    const toml::table* t = table("composition");
    if (!t) return;
    double sum = 0;
    for (const auto& [key, node] : *t) {
      const double share = node.value<double>().value_or(0);
      if (share >= 0 && share <= 100) sum += share;  // others have been told
    }
    // A half for what rounding of the shares can add up to.
    if (sum > 100.5) {
      add(t->source().begin.line, "composition",
          fmt::format("adds up to {:g} wt%; expected at most 100", sum));
    }
  }

  void check_measurements() {
    const toml::table* t = table("provenance");
    const toml::node* node = t ? t->get("measurements") : nullptr;
    if (!node) return;
    for (const std::string& name : csv_names(*node)) {
      const fs::path file = fs::path(path_).parent_path() / name;
      std::error_code ec;
      const std::size_t line = node->source().begin.line;
      if (!fs::is_regular_file(file, ec)) {
        add(line, "provenance.measurements",
            fmt::format("{} is not there; expected the file beside this one", name));
        continue;
      }
      try {
        for (const std::string& w : read_measurements({file.string()}).warnings) {
          add(line, "provenance.measurements", w, true);
        }
      } catch (const Error& e) {
        add(line, "provenance.measurements", e.what());
      }
    }
  }

  void check_flat_field() {
    const toml::table* t = table("display");
    const toml::node* node = t ? t->get("flat_field") : nullptr;
    if (!node || !node->is_string()) return;
    const std::size_t line = node->source().begin.line;
    const fs::path file = fs::path(path_).parent_path() / **node->as_string();
    try {
      const FlatField field = flat_field_of_png(file.string());
      // The image has 255 steps and the file's numbers four digits.
      constexpr double tolerance = 0.5 / 255 + 1e-4;
      const auto compare = [&](const char* key, double measured) {
        const auto given = number("display", key);
        if (given && std::abs(*given - measured) > tolerance) {
          add(line_of("display", key), full("display", key),
              fmt::format("is {:g}, but {} has {:.4f}", *given, file.filename().string(),
                          measured));
        }
      };
      compare("flat_field_least", field.least);
      compare("flat_field_mean", field.mean);
      check_shape(field, file.string(), line);
    } catch (const Error& e) {
      add(line, "display.flat_field", e.what());
    }
  }

  /// Blue and patterned UV images need a channel of the display each.
  void check_projector() {
    const auto word = [&](std::string_view in, std::string_view key, std::string_view fallback) {
      const toml::table* t = table(in);
      const toml::node* node = t ? t->get(key) : nullptr;
      return node && node->is_string() ? std::string(**node->as_string()) : std::string(fallback);
    };
    const bool patterned = word("uv", "kind", "flood") == "patterned";
    const toml::table* t = table("projector");
    if (!t) return;
    if (t->contains("uv") && !patterned) {
      add(line_of("projector", "uv"), "projector.uv",
          "is given; expected kind = \"patterned\" under [uv], too");
    }
    const std::string blue = word("projector", "blue", "blue"), uv = word("projector", "uv", "red");
    if (patterned && (blue == uv || blue == "all")) {
      const std::string key = t->contains("uv") ? "uv" : "blue";
      add(line_of("projector", key), "projector." + key,
          fmt::format("puts blue and UV images into the same channel (\"{}\", \"{}\"); expected "
                      "one of its own for each",
                      blue, uv));
    }
  }

  void check_shape(const FlatField& field, const std::string& file, std::size_t line) {
    std::optional<Printer> printer;
    try {
      printer = parse_printer(text_, path_);
    } catch (const Error&) {
      return;  // said elsewhere
    }
    slicecorr::FlatField map;
    map.width_px = field.image.width_px;
    map.height_px = field.image.height_px;
    const toml::node* frame = table("display")->get("flat_field_frame");
    map.of_plate = frame && frame->is_string() && **frame->as_string() == "plate";
    try {
      slicecorr::check_flat_field(map, *printer, file);
    } catch (const Error& e) {
      add(line, "display.flat_field", e.what());
    }
  }

  /// What the parser says, unless it has been said. Its message is "FILE: line N: KEY: text".
  void ask_parser() {
    try {
      if (kind_ == "resin") {
        parse_resin(text_, path_);
      } else {
        parse_printer(text_, path_);
      }
    } catch (const Error& e) {
      std::string message = e.what();
      int line = 0;
      std::string key;
      const std::string head = path_ + ": line ";
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
        key = kind_ == "printer" ? "calibration" : "";
      }
      const bool told = std::any_of(found_.begin(), found_.end(), [&](const Finding& f) {
        return !f.warning &&
               (f.key == key || (line > 0 && f.line == line) ||
                f.message.ends_with(fmt::format("'{}'?", key.substr(key.find_last_of('.') + 1))));
      });
      if (!told) add(line, key, message);
    }
  }

  const std::string& text_;
  std::string path_, kind_;
  toml::table root_;
  std::vector<Finding> found_;
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
  if (!ec && size > most_definition_bytes) {
    return one(fmt::format("has {:.1f} MiB; expected a definition of at most {} MiB",
                           static_cast<double>(size) / (1U << 20), most_definition_bytes >> 20));
  }
  try {
    return validate_text(read_text_file(path), path);
  } catch (const Error& e) {
    return one(e.what());
  }
}

}  // namespace slicecorr::resins
