// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <filesystem>

#include "process/chemistry_keys.hpp"
#include "process/flat_field_keys.hpp"
#include "process/spread_keys.hpp"
#include "process/tomography_keys.hpp"
#include "process/unit_key.hpp"
#include "process/vat_window_keys.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/image_size.hpp"
#include "slicecorr/light_unit.hpp"
#include "slicecorr/process.hpp"
#include "slicecorr/rules_file.hpp"
#include "slicecorr/units.hpp"
#include "slicecorr/unmeasured_light.hpp"
#include "support/files/shared_object.hpp"
#include "support/text/ascii.hpp"
#include "support/text/csv.hpp"
#include "support/text/nearest.hpp"
#include "support/toml/toml_table.hpp"

#ifndef SLICECORR_INSTALLED_DB
#define SLICECORR_INSTALLED_DB "/usr/share/slicecorr/db"
#endif
#ifndef SLICECORR_SOURCE_DB
#define SLICECORR_SOURCE_DB ""
#endif

namespace slicecorr {

namespace {

namespace fs = std::filesystem;

std::vector<CalibrationPoint> calibration_from_csv(const TomlTable& table,
                                                   const std::string& file) {
  fs::path path = file;
  if (path.is_relative()) path = fs::path(table.source()).parent_path() / path;
  std::error_code ec;
  if (!fs::is_regular_file(path, ec)) {
    table.fail("calibration", fmt::format("{} is not a file that can be read", path.string()));
  }
  std::vector<CalibrationPoint> points;
  CsvReader reader = CsvReader::of_text(read_text_file(path.string()), path.string());
  for (CsvRow row; reader.next(row);) {
    const auto level = number_in_text(row.cells.front());
    const auto intensity = number_in_text(row.cells.back());
    if (row.cells.size() != 2 || !level || !intensity || row.fault != CsvRow::Fault::none) {
      if (points.empty() && (row.cells.front().empty() || !is_digit(row.cells.front()[0])))
        continue;  // header row
      throw InputError(path.string(), reader.place(), "expected 'grey level, mW/cm²'");
    }
    points.push_back({*level, *intensity});
  }
  return points;
}

/// `whole_range`: the curve must cover all levels of `bit_depth` bits.
std::vector<CalibrationPoint> calibration(const TomlTable& blue, int bit_depth, bool whole_range) {
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
  if (whole_range && (points.front().level != 0 || points.back().level != top)) {
    blue.fail(key, fmt::format("goes from level {:g} to {:g}; expected 0 to {:g} for {} bits",
                               points.front().level, points.back().level, top, bit_depth));
  }
  if (points.back().intensity_mw_cm2 <= 0) blue.fail(key, "expected some light at full level");
  return points;
}

}  // namespace

const char* name_of(CureModelKind model) {
  switch (model) {
    case CureModelKind::jacobs:
      return "jacobs";
    case CureModelKind::kinetic:
      return "kinetic";
    case CureModelKind::gel_time:
      return "gel-time";
  }
  return "";
}

namespace {

/// How the display turns what the plate looks like; nothing when the file does not say.
std::optional<Orientation> orientation_of(const TomlTable& display) {
  const toml::node* mirror = display.node("mirror");
  if (!mirror && !display.has("orientation")) return std::nullopt;
  Orientation o;
  const std::string side = display.text("orientation", "landscape");
  if (side != "landscape" && side != "portrait") {
    display.fail("orientation",
                 fmt::format("is '{}'; expected \"landscape\" or \"portrait\"", side));
  }
  o.portrait = side == "portrait";
  if (!mirror) return o;
  const std::string way = mirror->is_boolean()  ? (**mirror->as_boolean() ? "x" : "none")
                          : mirror->is_string() ? **mirror->as_string()
                                                : "";
  if (way != "none" && way != "x" && way != "y" && way != "xy") {
    display.fail("mirror", "expected true, false, \"none\", \"x\", \"y\" or \"xy\"");
  }
  o.mirror_x = way.find('x') != std::string::npos;
  o.mirror_y = way.find('y') != std::string::npos;
  return o;
}

}  // namespace

std::vector<std::string> definition_folders(std::string_view kind) {
  std::vector<std::string> folders;
  const auto add = [&](const fs::path& folder) {
    for (const fs::path& path : {folder, folder / (std::string(kind) + "s")}) {
      const std::string text = path.lexically_normal().string();
      if (std::find(folders.begin(), folders.end(), text) == folders.end()) folders.push_back(text);
    }
  };
  const auto variable = [](const char* name) {
    const char* value = std::getenv(name);
    return std::string(value ? value : "");
  };
  if (const std::string own = variable("SLICECORR_DB"); !own.empty()) add(own);
  if (const std::string user = user_definition_folder(); !user.empty()) add(user);
  // An install tree that was moved or made with another prefix is found from the program.
  std::error_code ec;
  const fs::path program = fs::read_symlink("/proc/self/exe", ec);
  if (!ec) add(program.parent_path() / ".." / "share" / "slicecorr" / "db");
  // A Python wheel has them beside the library that it brings.
  if (const fs::path own = detail::own_folder(); !own.empty()) {
    add(own / ".." / "share" / "slicecorr" / "db");
  }
  add(SLICECORR_INSTALLED_DB);
  // The source tree keeps resins in resins/db and printers in resins/printers.
  if (const fs::path source = SLICECORR_SOURCE_DB; !source.empty()) {
    add(kind == "printer" ? source / "printers" : source / "db");
  }
  return folders;
}

std::string user_definition_folder() {
  if (const char* config = std::getenv("XDG_CONFIG_HOME"); config && *config) {
    return (fs::path(config) / "slicecorr").string();
  }
  const char* home = std::getenv("HOME");
  return home && *home ? (fs::path(home) / ".config" / "slicecorr").string() : "";
}

bool is_rules_file(const std::string& path) {
  try {
    const toml::table table = parse_toml(read_text_file(path), path);
    return table.contains("rule") || table.contains("default");
  } catch (const InputError&) {
    return false;
  }
}

std::vector<Definition> list_definitions(std::string_view kind) {
  std::vector<Definition> found;
  for (const std::string& folder : definition_folders(kind)) {
    std::error_code ec;
    std::vector<Definition> here;
    for (const auto& entry : fs::directory_iterator(folder, ec)) {
      const fs::path& path = entry.path();
      std::error_code no_file;
      if (path.extension() != ".toml" || path.filename().string()[0] == '.' ||
          !entry.is_regular_file(no_file)) {
        continue;
      }
      // A folder may hold both kinds: a printer has a display. And rules of slicecorr-post.
      const auto is = kind_of_definition(path.string());
      if (is ? *is != kind : is_rules_file(path.string())) continue;
      here.push_back({path.stem().string(), path.string()});
    }
    std::sort(here.begin(), here.end(),
              [](const Definition& a, const Definition& b) { return a.name < b.name; });
    for (Definition& d : here) {
      const bool hidden = std::any_of(found.begin(), found.end(),
                                      [&](const Definition& f) { return f.name == d.name; });
      if (!hidden) found.push_back(std::move(d));
    }
  }
  std::sort(found.begin(), found.end(),
            [](const Definition& a, const Definition& b) { return a.name < b.name; });
  return found;
}

std::optional<std::string> kind_of_definition(const std::string& path) {
  try {
    const toml::table table = parse_toml(read_text_file(path), path);
    if (table.contains("cure")) return "resin";
    if (table.contains("display")) return "printer";
  } catch (const InputError&) {
  }
  return std::nullopt;
}

std::string find_definition(const std::string& name, std::string_view kind) {
  if (name.size() > 5 && name.substr(name.size() - 5) == ".toml") return name;
  if (name.empty() || name.find('/') != std::string::npos || name[0] == '.') {
    throw InputError(
        fmt::format("'{}' is no {} name; expected a name or a .toml file", name, kind));
  }
  std::string looked;
  for (const std::string& folder : definition_folders(kind)) {
    const fs::path path = fs::path(folder) / (name + ".toml");
    std::error_code ec;
    if (fs::is_regular_file(path, ec)) return path.string();
    looked += (looked.empty() ? "" : ", ") + folder;
  }
  std::string known;
  const std::vector<Definition> definitions = list_definitions(kind);
  std::vector<std::string_view> names;
  for (const Definition& d : definitions) {
    known += (known.empty() ? "" : ", ") + d.name;
    names.push_back(d.name);
  }
  // Where it can only be a slip, all that is known would hide the one name.
  if (const std::string near = nearest(name, names); !near.empty()) {
    throw InputError(fmt::format("no {0} '{1}'; did you mean '{2}'? Looked for {1}.toml in {3}",
                                 kind, name, near, looked));
  }
  // Half of a name, as people call it.
  std::string longer;
  for (const std::string_view known_name : names) {
    if (known_name.find(name) == std::string_view::npos) continue;
    longer += fmt::format("{}'{}'", longer.empty() ? "" : " or ", known_name);
  }
  if (!longer.empty()) {
    throw InputError(fmt::format("no {0} '{1}'; did you mean {2}? Looked for {1}.toml in {3}", kind,
                                 name, longer, looked));
  }
  throw InputError(fmt::format("no {0} '{1}'; looked for {1}.toml in {2}; known {0}s: {3}", kind,
                               name, looked, known.empty() ? "none" : known));
}

namespace {

/// Takes `[blue] unit`, and refuses what needs mW/cm² beside light of another unit.
void take_unit(const TomlTable& root, const TomlTable& blue, Printer& printer) {
  printer.unit = detail::unit_key(blue);
  if (printer.unit == LightUnit::mw_cm2) return;
  for (const char* table : {"uv", "vial", "optics", "rotation", "beams"}) {
    if (!root.has(table)) continue;
    blue.fail(
        "unit",
        fmt::format("is \"{}\", and the file has a [{}], which counts light in mW/cm²; expected "
                    "one of both",
                    unit_in_files(printer.unit), table));
  }
  if (!printer.calibration.empty() && printer.calibration.back().intensity_mw_cm2 != 1) {
    blue.fail("calibration",
              fmt::format("ends at {:g}; expected 1, the brightest level, in its own unit",
                          printer.calibration.back().intensity_mw_cm2));
  }
}

bool is_to_be_measured(const TomlTable& blue) {
  const toml::node* node = blue.node("calibration");
  return node && node->is_string() && **node->as_string() == kToBeMeasured;
}

/// What a printer file says of lifts: nothing where it does not say how far the platform lifts.
std::optional<LiftMotion> lift_motion(const TomlTable& stage, double max_speed_mm_h) {
  constexpr double mm_s_of_mm_h = 1.0 / 3600;
  const auto up_mm = stage.number("lift_mm", 0, kMostLiftMm, true);
  const double speed_mm_h = stage.number("lift_speed_mm_h", 0, 1e6).value_or(max_speed_mm_h);
  const double return_mm_h = stage.number("return_speed_mm_h", 0, 1e6).value_or(speed_mm_h);
  if (stage.has("wait_s") && stage.has("settle_s")) {
    stage.fail("wait_s", "is given beside settle_s, which is the same; expected one of them");
  }
  const auto wait_s = stage.number("wait_s", 0, kMostLiftWaitS, true);
  const auto settle_s = stage.number("settle_s", 0, kMostLiftWaitS, true);
  const double acceleration_mm_s2 = stage.number("acceleration_mm_s2", 0, 1e5).value_or(0);
  if (!up_mm) return std::nullopt;
  if (*up_mm > 0 && !(speed_mm_h > 0)) {
    stage.fail("lift_mm", "is given without a speed; expected lift_speed_mm_h beside it");
  }
  LiftMotion motion;
  motion.up_mm = *up_mm;
  motion.up_mm_s = speed_mm_h * mm_s_of_mm_h;
  motion.back_mm_s = return_mm_h * mm_s_of_mm_h;
  motion.before_light_s = wait_s ? *wait_s : settle_s.value_or(kDefaultLiftWaitS);
  motion.acceleration_mm_s2 = acceleration_mm_s2;
  return motion;
}

Printer printer_of(std::string_view text, const std::string& source, bool needs_light) {
  const toml::table root_table = parse_toml(text, source);
  const TomlTable root(root_table, source);
  Printer printer;
  printer.name = root.text("name", fs::path(source).stem().string());
  printer.unread = unread_words(text, source, "printer");
  const TomlTable display = root.required_table("display");
  printer.width_px = display.required_integer("width_px", 1, kMostPixelsAcross);
  printer.height_px = display.required_integer("height_px", 1, kMostPixelsAcross);
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
  printer.fill_factor = display.number("fill_factor", 0, 1).value_or(1);
  printer.orientation = orientation_of(display);
  detail::flat_field_keys(display);
  if (const toml::node* node = display.node("distortion"); node && !node->is_string()) {
    display.fail("distortion", "expected the name of a CSV file with x_px,y_px,x_mm,y_mm");
  }
  const TomlTable blue = root.required_table("blue");
  printer.wavelength_nm = blue.number("wavelength_nm", 0, 1e5).value_or(0);
  if (!is_to_be_measured(blue)) {
    printer.calibration = calibration(blue, printer.bit_depth, true);
  } else if (needs_light) {
    blue.fail("calibration", "is " + how_to_measure_light(printer) +
                                 "; expected [[grey level, mW/cm²], ...] or a .csv file");
  }
  take_unit(root, blue, printer);
  const std::string grey = blue.text("grey", "steady");
  if (grey != "steady" && grey != "pulsed") {
    blue.fail("grey", fmt::format("is '{}'; expected \"steady\" or \"pulsed\"", grey));
  }
  printer.grey = grey == "pulsed" ? GreyLight::pulsed : GreyLight::steady;
  printer.spread.gaussians = detail::spread_keys(blue, printer).gaussians;
  if (const auto uv = root.table("uv")) {
    UvLamp lamp;
    lamp.wavelength_nm = uv->number("wavelength_nm", 0, 1e5).value_or(0);
    const std::string kind = uv->text("kind", "flood");
    if (kind != "flood" && kind != "patterned") {
      uv->fail("kind", fmt::format("is '{}'; expected \"flood\" or \"patterned\"", kind));
    }
    lamp.patterned = kind == "patterned";
    // A lamp's control values are its own; an image's are grey levels.
    lamp.calibration = calibration(*uv, printer.bit_depth, lamp.patterned);
    lamp.spread.gaussians = detail::spread_keys(*uv, printer).gaussians;
    if (uv->has("spread") && !lamp.patterned) {
      uv->fail("spread",
               "is given for a flood, which is even; expected it with kind = "
               "\"patterned\"");
    }
    detail::lamp_field_keys(*uv);
    printer.uv = std::move(lamp);
  }
  if (const auto stage = root.table("stage")) {
    printer.max_speed_mm_h = stage->number("max_speed_mm_h", 0, 1e9).value_or(0);
    printer.travel_mm = stage->number("travel_mm", 0, 1e6).value_or(0);
    printer.lift_motion = lift_motion(*stage, printer.max_speed_mm_h);
  }
  if (const auto process = root.table("process")) {
    const std::string lifts = process->text("lifts", "each");
    if (lifts != "each" && lifts != "none") {
      process->fail("lifts", fmt::format("is '{}'; expected \"each\" or \"none\"", lifts));
    }
    printer.lifts = lifts == "each" ? Lifts::each : Lifts::none;
    printer.lift_exchange = process->number("lift_exchange", 0, 1, true).value_or(kUnknownExchange);
    printer.lift_exchange_sd = process->number("lift_exchange_sd", 0, 1).value_or(0);
    if (printer.lift_exchange_sd > 0 && printer.lift_exchange < 0) {
      process->fail("lift_exchange_sd", "is said without lift_exchange, whose error it is");
    }
    // Who only steps lifts nothing, whatever the stage could do.
    if (printer.lifts == Lifts::none && printer.lift_motion) printer.lift_motion->up_mm = 0;
  }
  if (const auto vat = root.table("vat")) {
    printer.resin_depth_um = vat->number("depth_um", 0, kMostDepthUm).value_or(0);
    printer.platform_reflectance = vat->number("platform_reflectance", 0, 1, true).value_or(0);
    if (root.has("suction_limit_pa") && vat->has("suction_limit_pa")) {
      vat->fail("suction_limit_pa",
                "is given here and at the top of the file; expected one of them");
    }
    printer.suction_limit_pa = vat->number("suction_limit_pa", 0, kMostSuctionPa).value_or(0);
    printer.adhesion_kpa = vat->number("adhesion_kpa", 0, kMostAdhesionKpa).value_or(0);
  }
  if (const auto window = root.table("window")) printer.window = detail::window_keys(*window);
  if (const auto limit = root.number("suction_limit_pa", 0, kMostSuctionPa)) {
    printer.suction_limit_pa = *limit;
  }
  if (const auto provenance = root.table("provenance")) {
    const toml::node* const said = provenance->node("measurements");
    const auto text = said ? said->value<std::string>() : std::nullopt;
    printer.model = text && text->find("model printer") != std::string::npos;
  }
  detail::tomography_keys(root, printer);
  if (display.has("distortion") && (printer.vial || printer.optics || printer.rotation)) {
    display.fail(
        "distortion",
        "is not counted in tomographic printing, whose rays [optics] says; expected one of both");
  }
  return printer;
}

}  // namespace

Printer parse_printer(std::string_view text, const std::string& source) {
  return printer_of(text, source, true);
}

Printer parse_display(std::string_view text, const std::string& source) {
  return printer_of(text, source, false);
}

bool light_is_measured(const Printer& printer) { return !printer.calibration.empty(); }

std::string how_to_measure_light(const Printer& printer) {
  return fmt::format(
      "{}: nobody has told yet how bright the display of printer '{}' is at each grey level. Lay a "
      "power meter{} on the display without its vat, show even images of many grey levels, dark ones "
      "close together, 0 and {} among them, and note the mW/cm² of each. slicecorr testpart levels makes "
      "these images, with a table to fill in, and resinctl import a printer file of the table. Who has "
      "calipers and no power meter takes slicecorr testpart films and resinctl calibrate; layer by layer "
      "the setting assume, typical, takes the light of typical displays",
      kToBeMeasured, printer.name,
      printer.wavelength_nm > 0 ? fmt::format(" for {:g} nm", printer.wavelength_nm) : "",
      printer.levels() - 1);
}

}  // namespace slicecorr
