#include <fmt/format.h>
#include <toml++/toml.h>

#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <sstream>

#include "slicecorr/error.hpp"
#include "slicecorr/process.hpp"
#include "slicecorr/units.hpp"

#ifndef SLICECORR_INSTALLED_DB
#define SLICECORR_INSTALLED_DB "/usr/share/slicecorr/db"
#endif
#ifndef SLICECORR_SOURCE_DB
#define SLICECORR_SOURCE_DB ""
#endif

namespace slicecorr {

namespace {

namespace fs = std::filesystem;

/// A TOML table with the file it comes from, so that every complaint names file, line and key.
class Table {
 public:
  Table(const toml::table& table, std::string source, std::string prefix = "")
      : table_(table), source_(std::move(source)), prefix_(std::move(prefix)) {}

  [[noreturn]] void fail(std::string_view key, const std::string& message) const {
    const toml::node* node = table_.get(key);
    const auto line = node ? node->source().begin.line : table_.source().begin.line;
    throw InputError(source_, fmt::format("line {}: {}{}", line, prefix_, key), message);
  }

  std::optional<Table> table(std::string_view key) const {
    const toml::node* node = table_.get(key);
    if (!node) return std::nullopt;
    if (!node->is_table()) fail(key, "expected a table");
    return Table(*node->as_table(), source_, prefix_ + std::string(key) + ".");
  }
  Table required_table(std::string_view key) const {
    auto t = table(key);
    if (!t) fail(key, "missing; expected a table");
    return *t;
  }

  bool has(std::string_view key) const { return table_.get(key) != nullptr; }
  const toml::node* node(std::string_view key) const { return table_.get(key); }

  std::string text(std::string_view key, const std::string& fallback) const {
    const toml::node* node = table_.get(key);
    if (!node) return fallback;
    if (!node->is_string()) fail(key, "expected a text in quotes");
    return **node->as_string();
  }

  /// A number in (low, high], or [low, high] when `closed`.
  std::optional<double> number(std::string_view key, double low, double high,
                               bool closed = false) const {
    const toml::node* node = table_.get(key);
    if (!node) return std::nullopt;
    const auto value = node->value<double>();
    if (!value || !node->is_number()) fail(key, "expected a number");
    const bool low_fits = closed ? *value >= low : *value > low;
    if (!std::isfinite(*value) || !low_fits || *value > high) {
      fail(key, fmt::format("is {:g}; expected a number {} {:g} and at most {:g}", *value,
                            closed ? "of at least" : "above", low, high));
    }
    return value;
  }
  double required_number(std::string_view key, double low, double high) const {
    const auto value = number(key, low, high);
    if (!value) fail(key, "missing; expected a number");
    return *value;
  }
  int required_integer(std::string_view key, int low, int high) const {
    const toml::node* node = table_.get(key);
    if (!node) fail(key, "missing; expected a whole number");
    return integer(key, low, high, low);
  }
  int integer(std::string_view key, int low, int high, int fallback) const {
    const toml::node* node = table_.get(key);
    if (!node) return fallback;
    if (!node->is_integer()) fail(key, "expected a whole number");
    const auto value = **node->as_integer();
    if (value < low || value > high) {
      fail(key, fmt::format("is {}; expected {} to {}", value, low, high));
    }
    return static_cast<int>(value);
  }
  const std::string& source() const { return source_; }

 private:
  const toml::table& table_;
  std::string source_, prefix_;
};

toml::table parse_toml(std::string_view text, const std::string& source) {
  try {
    return toml::parse(text, source);
  } catch (const toml::parse_error& e) {
    throw InputError(source, fmt::format("line {}", e.source().begin.line),
                     fmt::format("is not TOML: {}", e.description()));
  }
}

std::string read_text(const std::string& path) {
  std::error_code ec;
  if (!fs::is_regular_file(path, ec)) throw InputError(path, "", "is not a file that can be read");
  std::ifstream in(path, std::ios::binary);
  std::stringstream text;
  text << in.rdbuf();
  if (!in) throw InputError(path, "", "can't be read");
  return text.str();
}

std::vector<CalibrationPoint> calibration_from_csv(const Table& table, const std::string& file) {
  fs::path path = file;
  if (path.is_relative()) path = fs::path(table.source()).parent_path() / path;
  std::error_code ec;
  if (!fs::is_regular_file(path, ec)) {
    table.fail("calibration", fmt::format("{} is not a file that can be read", path.string()));
  }
  std::istringstream lines(read_text(path.string()));
  std::vector<CalibrationPoint> points;
  std::string line;
  for (int number = 1; std::getline(lines, line); ++number) {
    if (!line.empty() && line.back() == '\r') line.pop_back();
    if (line.find_first_not_of(" \t") == std::string::npos || line[0] == '#') continue;
    double level = 0, intensity = 0;
    char comma = 0, rest = 0;
    std::istringstream fields(line);
    if (!(fields >> level >> comma >> intensity) || comma != ',' || fields >> rest) {
      if (points.empty() && line.find_first_of("0123456789") != 0) continue;  // header row
      throw InputError(path.string(), fmt::format("line {}", number),
                       "expected 'grey level, mW/cm²'");
    }
    points.push_back({level, intensity});
  }
  return points;
}

std::vector<CalibrationPoint> calibration(const Table& blue, int bit_depth) {
  const char* key = "calibration";
  const toml::node* node = blue.node(key);
  if (!node) blue.fail(key, "missing; expected [[grey level, mW/cm²], ...] or a .csv file");
  std::vector<CalibrationPoint> points;
  if (node->is_string()) {
    points = calibration_from_csv(blue, **node->as_string());
  } else {
    if (!node->is_array()) blue.fail(key, "expected [[grey level, mW/cm²], ...]");
    for (const auto& element : *node->as_array()) {
      const auto* pair = element.as_array();
      if (!pair || pair->size() != 2 || !pair->get(0)->is_number() || !pair->get(1)->is_number()) {
        blue.fail(key, "expected pairs [grey level, mW/cm²]");
      }
      points.push_back({*pair->get(0)->value<double>(), *pair->get(1)->value<double>()});
    }
  }
  const double top = (1 << bit_depth) - 1;
  if (points.size() < 2) blue.fail(key, "expected at least two points");
  for (std::size_t i = 0; i < points.size(); ++i) {
    const auto& p = points[i];
    if (!std::isfinite(p.level) || !std::isfinite(p.intensity_mw_cm2) || p.intensity_mw_cm2 < 0 ||
        p.intensity_mw_cm2 > 1e6) {
      blue.fail(key, fmt::format("point {} [{:g}, {:g}]: expected an intensity of 0 to 1e6 mW/cm²",
                                 i + 1, p.level, p.intensity_mw_cm2));
    }
    if (i && p.level <= points[i - 1].level) {
      blue.fail(key, fmt::format("point {}: grey levels must rise, {:g} comes after {:g}", i + 1,
                                 p.level, points[i - 1].level));
    }
    if (i && p.intensity_mw_cm2 < points[i - 1].intensity_mw_cm2) {
      blue.fail(key, fmt::format("point {}: the curve must not fall, {:g} comes after {:g} mW/cm²",
                                 i + 1, p.intensity_mw_cm2, points[i - 1].intensity_mw_cm2));
    }
  }
  if (points.front().level != 0 || points.back().level != top) {
    blue.fail(key, fmt::format("goes from level {:g} to {:g}; expected 0 to {:g} for {} bits",
                               points.front().level, points.back().level, top, bit_depth));
  }
  if (points.back().intensity_mw_cm2 <= 0) blue.fail(key, "expected some light at full level");
  return points;
}

double absorbance_height10(const Table& cure) {
  const double height = cure.required_number("absorbance_height_um", 0, 1e7);
  const toml::node* base = cure.node("absorbance_base");
  if (!base) cure.fail("absorbance_base", "missing; expected 10 or \"e\"");
  if (base->is_integer() && **base->as_integer() == 10) return height;
  if (base->is_string() && **base->as_string() == "e") return units::height10_from_e(height);
  if (base->is_string() && **base->as_string() == "10") return height;
  cure.fail("absorbance_base", "expected 10 or \"e\"");
}

void resolve_dose(const Table& cure, std::optional<double> dose_override, Resin& resin) {
  const double height_e_um = units::height_e_from_10(resin.absorbance_height10_um);
  const auto areal_or_volumetric = [&](const char* volumetric, const char* areal) {
    const auto v = cure.number(volumetric, 0, 1e9);
    const auto s = cure.number(areal, 0, 1e9);
    if (v && s)
      cure.fail(areal, fmt::format("is given beside {}; expected one of them", volumetric));
    if (s) return std::optional(units::volumetric_from_areal(*s, height_e_um));
    return v;
  };
  const auto gel = areal_or_volumetric("gel_dose_mj_cm3", "gel_dose_mj_cm2");
  const auto factor = cure.number("dose_factor", 0, 1e3);
  const auto critical = areal_or_volumetric("critical_dose_mj_cm3", "critical_dose_mj_cm2");
  const auto prime = cure.number("critical_dose_prime", 0, 1e9);
  if (gel) resin.gel_dose_mj_cm3 = *gel;
  if (resin.m != 1.0) {
    // Intensity times time says nothing here: D'c alone counts.
    if (dose_override) {
      cure.fail("m", fmt::format("is {:g}; a dose in mJ/cm³ can only replace that of a resin with "
                                 "m = 1",
                                 resin.m));
    }
    if (!prime) {
      cure.fail("critical_dose_prime", "missing; a resin with m other than 1 needs it");
    }
    resin.critical_dose_prime = *prime * factor.value_or(1.0);
  } else if (dose_override) {
    resin.critical_dose_mj_cm3 = *dose_override;
  } else if (critical) {
    resin.critical_dose_mj_cm3 = *critical;
  } else if (prime && resin.model == CureModelKind::kinetic) {
    resin.critical_dose_prime = *prime * factor.value_or(1.0);
    resin.critical_dose_mj_cm3 =
        units::volumetric_from_areal(resin.critical_dose_prime, height_e_um);
  } else if (gel) {
    if (!factor) cure.fail("dose_factor", "missing; gel dose and factor give the dose to aim at");
    resin.critical_dose_mj_cm3 = *gel * *factor;
  } else {
    cure.fail("critical_dose_mj_cm3",
              "missing; expected a critical dose, or gel_dose_mj_cm3 and dose_factor");
  }
}

/// A value that replaces one of the file's keeps to the same limits.
void check_override(const std::optional<double>& value, const char* what, double most) {
  if (value && !(*value > 0 && *value <= most)) {
    throw InputError(
        fmt::format("{} is {:g}; expected a number above 0 and at most {:g}", what, *value, most));
  }
}

}  // namespace

std::string find_definition(const std::string& name, std::string_view kind) {
  if (name.size() > 5 && name.substr(name.size() - 5) == ".toml") return name;
  if (name.empty() || name.find('/') != std::string::npos || name[0] == '.') {
    throw InputError(
        fmt::format("'{}' is no {} name; expected a name or a .toml file", name, kind));
  }
  std::vector<fs::path> folders;
  const auto add = [&](const char* value, const char* below = "") {
    if (value && *value) folders.push_back(fs::path(value) / below);
  };
  add(std::getenv("SLICECORR_DB"));
  if (const char* config = std::getenv("XDG_CONFIG_HOME"); config && *config) {
    add(config, "slicecorr");
  } else {
    add(std::getenv("HOME"), ".config/slicecorr");
  }
  // An install tree that was moved or made with another prefix is found from the program.
  std::error_code ec_exe;
  const fs::path program = fs::read_symlink("/proc/self/exe", ec_exe);
  if (!ec_exe) folders.push_back(program.parent_path() / ".." / "share" / "slicecorr" / "db");
  add(SLICECORR_INSTALLED_DB);
  add(SLICECORR_SOURCE_DB);
  std::string looked;
  for (const auto& folder : folders) {
    for (const std::string& below : {std::string(), std::string(kind) + "s"}) {
      const fs::path path = folder / below / (name + ".toml");
      std::error_code ec;
      if (fs::is_regular_file(path, ec)) return path.string();
    }
    looked += (looked.empty() ? "" : ", ") + folder.string();
  }
  throw InputError(fmt::format("no {} '{}'; looked for {}.toml in {}", kind, name, name, looked));
}

Printer parse_printer(std::string_view text, const std::string& source) {
  const toml::table root_table = parse_toml(text, source);
  const Table root(root_table, source);
  Printer printer;
  printer.name = root.text("name", fs::path(source).stem().string());
  const Table display = root.required_table("display");
  printer.width_px = display.required_integer("width_px", 1, 65536);
  printer.height_px = display.required_integer("height_px", 1, 65536);
  printer.bit_depth = display.integer("bit_depth", 1, 8, 8);
  if (const toml::node* pixel = display.node("pixel_um"); pixel && pixel->is_array()) {
    const auto* pair = pixel->as_array();
    const auto side = [&](std::size_t i) {
      const auto value = pair->size() == 2 && pair->get(i)->is_number()
                             ? pair->get(i)->value<double>()
                             : std::nullopt;
      if (!value || !(*value > 0) || *value > 1e4) {
        display.fail("pixel_um", "expected a number or [x, y], above 0 and at most 10000");
      }
      return *value;
    };
    printer.pixel_x_um = side(0);
    printer.pixel_y_um = side(1);
  } else {
    printer.pixel_x_um = printer.pixel_y_um = display.required_number("pixel_um", 0, 1e4);
  }
  const Table blue = root.required_table("blue");
  printer.wavelength_nm = blue.number("wavelength_nm", 0, 1e5).value_or(0);
  printer.calibration = calibration(blue, printer.bit_depth);
  if (const auto stage = root.table("stage")) {
    printer.max_speed_mm_h = stage->number("max_speed_mm_h", 0, 1e9).value_or(0);
    printer.travel_mm = stage->number("travel_mm", 0, 1e6).value_or(0);
  }
  return printer;
}

Printer load_printer(const std::string& name_or_path) {
  const std::string path = find_definition(name_or_path, "printer");
  return parse_printer(read_text(path), path);
}

Resin parse_resin(std::string_view text, const std::string& source,
                  const ResinOverrides& overrides) {
  const toml::table root_table = parse_toml(text, source);
  const Table root(root_table, source);
  Resin resin;
  resin.name = root.text("name", fs::path(source).stem().string());
  const Table cure = root.required_table("cure");
  const std::string model = cure.text("model", "jacobs");
  if (model != "jacobs" && model != "kinetic") {
    cure.fail("model", fmt::format("is '{}'; expected \"jacobs\" or \"kinetic\"", model));
  }
  resin.model = model == "kinetic" ? CureModelKind::kinetic : CureModelKind::jacobs;
  resin.m = cure.number("m", 0, 2).value_or(1.0);
  if (resin.model == CureModelKind::jacobs && resin.m != 1.0) {
    cure.fail("m",
              fmt::format("is {:g}; the Jacobs model has m = 1, others are \"kinetic\"", resin.m));
  }
  resin.absorbance_height10_um = absorbance_height10(cure);
  check_override(overrides.ha_um, "the absorbance height, um,", 1e7);
  check_override(overrides.dc_mj_cm3, "the dose to aim at, mJ/cm³,", 1e9);
  if (overrides.ha_um) resin.absorbance_height10_um = *overrides.ha_um;
  resolve_dose(cure, overrides.dc_mj_cm3, resin);
  return resin;
}

Resin load_resin(const std::string& name_or_path, const ResinOverrides& overrides) {
  const std::string path = find_definition(name_or_path, "resin");
  return parse_resin(read_text(path), path, overrides);
}

}  // namespace slicecorr
