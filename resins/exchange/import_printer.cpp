// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Measurements of a printer: its calibration curve, and how even its light is.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <utility>

#include "database/flat_field.hpp"
#include "database/toml_edit.hpp"
#include "exchange/csv.hpp"
#include "exchange/flat_field_form.hpp"
#include "exchange/import.hpp"
#include "exchange/light_readings.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/measuring_form.hpp"
#include "slicecorr/unmeasured_light.hpp"
#include "support/json/read_json.hpp"
#include "support/toml/toml_table.hpp"

namespace slicecorr::resins {

namespace {

/// The printer file that a measurement belongs to, under the new name.
TomlEdit printer_text(const ImportSource& source, const ImportOptions& options, std::string& name) {
  if (options.printer.empty()) {
    throw InputError(source.path, "",
                     "is a measurement of a printer; expected --printer, the file it belongs to");
  }
  const std::string path = find_definition(options.printer, "printer");
  name = options.name.empty() ? std::filesystem::path(path).stem().string() : options.name;
  TomlEdit text(read_text_file(path), path);
  text.set("", "name", toml_text(name));
  return text;
}

struct Reading {
  double level = 0, intensity = 0;
  int line = 0;  ///< of the file; of the first, where several were averaged
};

/// Makes intensities rise: neighbours that fall are put to their mean (isotonic least squares).
/// Returns the reading that this changes most, and by how much.
std::pair<Reading, double> make_rising(std::vector<Reading>& points) {
  struct Block {
    double sum = 0;
    std::size_t count = 0;
    double mean() const { return sum / static_cast<double>(count); }
  };
  std::vector<Block> blocks;
  for (const Reading& p : points) {
    blocks.push_back({p.intensity, 1});
    while (blocks.size() > 1 && blocks[blocks.size() - 2].mean() > blocks.back().mean()) {
      const Block last = blocks.back();
      blocks.pop_back();
      blocks.back().sum += last.sum;
      blocks.back().count += last.count;
    }
  }
  Reading most_changed;
  double greatest = 0;
  std::size_t i = 0;
  for (const Block& b : blocks) {
    for (std::size_t k = 0; k < b.count; ++k, ++i) {
      // A block of one keeps its number to the last bit.
      const double value = b.count == 1 ? points[i].intensity : b.mean();
      const double change = std::abs(points[i].intensity - value);
      if (change > greatest) {
        greatest = change;
        most_changed = points[i];
      }
      points[i].intensity = value;
    }
  }
  return {most_changed, greatest};
}

std::string calibration_array(const std::vector<Reading>& points) {
  std::string out = "[";
  for (std::size_t i = 0; i < points.size(); ++i) {
    out += fmt::format("{}[{:g}, {}],", i % 6 == 0 ? "\n  " : " ", points[i].level,
                       toml_number(points[i].intensity));
  }
  return out + "\n]";
}

/// The readings of a printer's UV meter, `uvSensorData` in the files of the Prusa SL1's firmware:
/// TOML by its calibration, JSON by its service menu; the keys are the same. There are meters of
/// two kinds, and both tell row by row.
class SensorReadings {
 public:
  explicit SensorReadings(const ImportSource& source) : path_(source.path) {
    const std::size_t first = source.text.find_first_not_of(" \t\r\n");
    if (first != std::string::npos && source.text[first] == '{') {
      read_json(source.text);
    } else {
      read_toml(source.text);
    }
    for (const auto& [columns, rows] : {std::pair{10, 6}, std::pair{5, 3}}) {
      if (values_.size() == static_cast<std::size_t>(columns * rows)) {
        columns_ = columns;
        rows_ = rows;
      }
    }
    if (columns_ == 0) fail_count(fmt::format("has {} numbers", values_.size()));
  }
  int columns() const { return columns_; }
  int rows() const { return rows_; }
  /// White is the brightest.
  GreyImage image() const {
    const double greatest = *std::max_element(values_.begin(), values_.end());
    GreyImage image{columns_, rows_, {}};
    for (const double v : values_) {
      image.pixels.push_back(
          static_cast<std::uint8_t>(greatest > 0 ? std::lround(v / greatest * 255) : 0));
    }
    return image;
  }

 private:
  [[noreturn]] void fail_count(const std::string& found) const {
    throw InputError(path_, "uvSensorData",
                     found + "; expected 60 (6 rows of 10) or 15 (3 rows of 5)");
  }
  void add(std::optional<double> value, const std::string& place) {
    if (!value || !std::isfinite(*value) || *value < 0) {
      throw InputError(path_, place, "expected numbers of at least 0");
    }
    values_.push_back(*value);
  }
  void read_toml(const std::string& text) {
    const toml::table root = parse_toml(text, path_);
    const auto* data = root.get("uvSensorData") ? root.get("uvSensorData")->as_array() : nullptr;
    if (!data) fail_count("is no list");
    for (const auto& node : *data) {
      add(node.is_number() ? node.value<double>() : std::nullopt,
          fmt::format("line {}: uvSensorData", node.source().begin.line));
    }
  }
  void read_json(const std::string& text) {
    const auto root = detail::read_json(text, {path_, ""});
    // The meter with one sensor in the middle says nothing of how even the light is.
    const auto type = root.find("uvSensorType");
    if (type != root.end() && (!type->is_number() || type->get<double>() != 0)) {
      throw InputError(path_, "uvSensorType",
                       fmt::format("is {}; expected 0, a meter of many sensors", type->dump()));
    }
    const auto data = root.find("uvSensorData");
    if (data == root.end() || !data->is_array()) fail_count("is no list");
    for (std::size_t i = 0; i < data->size(); ++i) {
      const auto& node = (*data)[i];
      add(node.is_number() ? std::optional(node.get<double>()) : std::nullopt,
          fmt::format("uvSensorData[{}]", i));
    }
  }

  std::string path_;
  std::vector<double> values_;
  int columns_ = 0, rows_ = 0;
};

/// Levels and light as a file has them: two columns, or, for a lookup table, the light alone.
std::vector<Reading> read_curve(const ImportSource& source, bool every_level, double levels) {
  // In a table of a test part what was not measured is empty, and nothing else may have changed.
  const bool form = source.text.find("# slicecorr testpart") < 8;
  if (form) {
    expect_form_of(source.path, {"levels"});
    read_form(source.path);
  }
  const CsvTable table(source.text, source.path, CsvTable::Header::optional);
  const std::size_t columns = table.header().size();
  const bool alone = every_level && columns == 1;
  if (columns != 2 && !alone) {
    throw InputError(
        source.path, "header",
        fmt::format("has {} {}; expected two: grey level, mW/cm²{}", columns,
                    columns == 1 ? "column" : "columns",
                    every_level ? "; or one: mW/cm², a row for each level from 0 on" : ""));
  }
  std::vector<Reading> points;
  for (const CsvTable::Row& row : table.rows()) {
    const std::string &first = table.header()[0], &light = table.header()[columns - 1];
    const double expected = static_cast<double>(points.size());
    if (every_level && expected >= levels) {
      table.fail(row, first,
                 fmt::format("is one row too many; expected {:g}, one for each level of the "
                             "printer's display",
                             levels));
    }
    const auto level = alone ? std::optional(expected) : table.number(row, first);
    const auto value = table.number(row, light);
    if (form && level && !value) continue;
    if (!level || !value) table.fail(row, level ? light : first, "is empty; expected a number");
    if (*value < 0) table.fail(row, light, fmt::format("is {:g}; expected at least 0", *value));
    if (every_level && *level != expected) {
      table.fail(row, first,
                 fmt::format("is level {:g}; expected {:g}: every level, once, from 0 on", *level,
                             expected));
    }
    points.push_back({*level, *value, row.line});
  }
  if (every_level && static_cast<double>(points.size()) < levels) {
    throw InputError(source.path, points.empty() ? "" : fmt::format("line {}", points.back().line),
                     fmt::format("ends at level {}; expected {:g} rows, one for each level of the "
                                 "printer's display",
                                 static_cast<std::ptrdiff_t>(points.size()) - 1, levels));
  }
  if (points.size() < 2) {
    throw InputError(source.path, "", "has fewer than two points; expected a curve");
  }
  std::stable_sort(points.begin(), points.end(),
                   [](const auto& a, const auto& b) { return a.level < b.level; });
  return points;
}

/// Throws where black or full light was not read.
void check_whole(const std::vector<Reading>& curve, double full_level, const std::string& path) {
  const auto check = [&](double level, const char* words, double read) {
    if (read == level) return;
    throw InputError(
        path, "",
        fmt::format("has no reading of {}, level {:g}: levels go from {:g} to {:g}; expected one",
                    words, level, curve.front().level, curve.back().level));
  };
  check(0, "black", curve.front().level);
  check(full_level, "full light", curve.back().level);
}

/// Throws where the light can be no printer's.
void check_light(const std::vector<Reading>& curve, const std::string& path) {
  constexpr double most_mw_cm2 = 2000, least_contrast = 1.05;
  const double black = curve.front().intensity, full = curve.back().intensity;
  if (full > most_mw_cm2) {
    throw InputError(
        path, "",
        fmt::format(
            "full light is {:g} mW/cm², more than {:g}; expected mW/cm² at the window: were these "
            "uW/cm²?",
            full, most_mw_cm2));
  }
  if (!(full >= least_contrast * black)) {
    throw InputError(
        path, "",
        fmt::format(
            "full light, {:g} mW/cm², is hardly brighter than black, {:g}; expected a display that "
            "shows grey, and a meter within its range",
            full, black));
  }
}

std::vector<Imported> import_curve(const ImportSource& source, const ImportOptions& options,
                                   const char* lamp, bool every_level) {
  Imported made;
  made.kind = "printer";
  TomlEdit edit = printer_text(source, options, made.name);
  const int bit_depth = parse_display(edit.text(), made.name + ".toml").bit_depth;
  const std::vector<Reading> points = read_curve(source, every_level, std::exp2(bit_depth));
  const std::size_t read = points.size();
  // Readings of the same level are averaged.
  std::vector<Reading> curve;
  for (std::size_t i = 0; i < points.size();) {
    std::size_t end = i;
    double sum = 0;
    while (end < points.size() && points[end].level == points[i].level) {
      sum += points[end++].intensity;
    }
    curve.push_back({points[i].level, sum / static_cast<double>(end - i), points[i].line});
    i = end;
  }
  auto& say = made.assumptions;
  say.push_back(
      fmt::format("Intensities are those at the window, mW/cm², between points a straight line; {} "
                  "readings at {} levels.",
                  read, curve.size()));
  if (curve.size() < read) say.emplace_back("Readings of the same level were averaged.");
  if (options.intensity_mw_cm2 > 0) {
    double greatest = 0;
    for (const Reading& p : curve) greatest = std::max(greatest, p.intensity);
    if (greatest == 0) {
      throw InputError(source.path, "", "is dark at every level; expected light");
    }
    for (Reading& p : curve) p.intensity *= options.intensity_mw_cm2 / greatest;
    say.push_back(
        fmt::format("Relative light: its greatest value, {:g}, was taken for the {:g} mW/cm² given "
                    "on the command line.",
                    greatest, options.intensity_mw_cm2));
  }
  check_whole(curve, std::exp2(bit_depth) - 1, source.path);
  const double top = curve.back().intensity;
  const auto [most_changed, changed] = make_rising(curve);
  if (changed > 0) {
    // What a meter scatters is smoothed; a curve that really falls must be looked at.
    constexpr double most = 0.02;
    if (changed > most * top) {
      throw InputError(
          source.path, fmt::format("line {}", most_changed.line),
          fmt::format("the curve falls: making it rise would change level {:g} by {:g} mW/cm², "
                      "more than {:g} % of full light; expected a curve that rises with the grey "
                      "level",
                      most_changed.level, changed, most * 100));
    }
    say.push_back(
        fmt::format("Readings that fell were put to the mean of their neighbours; greatest change "
                    "{:.3g} mW/cm².",
                    changed));
  }
  check_light(curve, source.path);
  std::string comment =
      fmt::format("# {}, mW/cm² at the window, from {}.",
                  std::string_view(lamp) == "uv" ? "Control value" : "Grey level", source.file);
  for (const std::string& a : say) comment += "\n# - " + a;
  edit.set(lamp, "calibration", calibration_array(curve));
  // What was read is in mW/cm², whatever stood there before.
  if (std::string_view(lamp) == "blue") edit.remove("blue", "unit");
  edit.set_comment(lamp, "calibration", comment);
  if (options.wavelength_nm > 0) {
    edit.set(lamp, "wavelength_nm", toml_number(options.wavelength_nm));
  }
  edit.set("provenance", std::string_view(lamp) == "uv" ? "uv_measurements" : "measurements",
           toml_text(fmt::format("calibration measured, {} readings, {}", read, source.file)));
  made.text = edit.text();
  parse_display(made.text, made.name + ".toml");
  return {made};
}

/// The light that a correction mask makes even.
FlatField light_behind(GreyImage mask, const std::string& path) {
  std::uint8_t least = 255;
  for (const std::uint8_t v : mask.pixels) least = std::min(least, v);
  if (least == 0) {
    throw InputError(path, "",
                     "has black pixels: as a correction that would mean endless light there; "
                     "expected a mask above 0");
  }
  for (std::uint8_t& v : mask.pixels) {
    v = static_cast<std::uint8_t>(std::lround(255.0 * least / v));
  }
  return flat_field_of(std::move(mask), path);
}

/// Maps that lie across a portrait display can only be maps of the plate.
void set_frame(TomlEdit& edit, const GreyImage& image, const std::string& path, Imported& made) {
  const Printer printer = parse_display(edit.text(), made.name + ".toml");
  edit.remove("display", "flat_field_reference");
  slicecorr::FlatField map;
  map.width_px = image.width_px;
  map.height_px = image.height_px;
  try {
    check_flat_field(map, printer, path);
    edit.remove("display", "flat_field_frame");
  } catch (const InputError&) {
    map.of_plate = true;
    try {
      check_flat_field(map, printer, path);
    } catch (const InputError&) {
      map.of_plate = false;
    }
    if (!map.of_plate) throw;
    edit.set("display", "flat_field_frame", toml_text("plate"));
    made.assumptions.emplace_back(
        "It lies across the images of the display, which are portrait: it was taken for one of the "
        "plate, its first row at the largest y, its first column at the smallest x.");
  }
}

}  // namespace

std::vector<Imported> import_calibration(const ImportSource& source, const ImportOptions& options,
                                         const char* lamp) {
  return import_curve(source, options, lamp, false);
}

std::vector<Imported> import_lookup_table(const ImportSource& source,
                                          const ImportOptions& options) {
  return import_curve(source, options, "blue", true);
}

std::vector<Imported> import_flat_field(const ImportSource& source, const ImportOptions& options,
                                        bool correction_mask) {
  Imported made;
  made.kind = "printer";
  TomlEdit edit = printer_text(source, options, made.name);
  auto& say = made.assumptions;
  FlatField field;
  Attachment image;
  image.table = "display";
  image.key = "flat_field";
  image.stem = made.name + "-flat-field";
  image.extension = ".png";
  const bool png = source.text.starts_with("\x89PNG");
  const bool plugs = source.text.find("# slicecorr testpart") < 8;
  const bool readings = !plugs && is_light_readings(source.text, source.path);
  std::optional<LightMapOfReadings> map;
  const bool of_plate = options.frame != "image";
  if (readings) {
    const Printer printer = parse_display(edit.text(), made.name + ".toml");
    const Grid plate = plate_grid(printer);
    const double width_um =
        of_plate ? plate.width_px * plate.pixel_x_um : printer.width_px * printer.pixel_x_um;
    const double height_um =
        of_plate ? plate.height_px * plate.pixel_y_um : printer.height_px * printer.pixel_y_um;
    map = map_of_readings(source, width_um * 1e-3, height_um * 1e-3);
    field = flat_field_of(map->image, source.path);
    say.push_back(fmt::format(
        "Readings with a meter, a smooth map laid through them ({}); they lie {:.2g} % of the "
        "brightest light from it in the mean.",
        of_plate ? "x and y in mm of the plate, from its corner at the least x and y"
                 : "x and y in mm of the display's images, from their lower left corner",
        100 * map->off_mean));
    if (!map->contradicted.empty()) say.push_back(map->contradicted + ".");
    std::string ninths;
    for (std::size_t i = 0; i < map->ninths.size(); ++i) {
      ninths += fmt::format("{}{:.0f}",
                            i == 0       ? ""
                            : i % 3 == 0 ? " / "
                                         : " ",
                            100 * map->ninths[i]);
    }
    say.push_back("Light in nine parts, % of the brightest, from the largest y down: " + ninths +
                  ".");
  } else if (plugs) {
    field = flat_field_of(light_of_plugs(source.path, options.height_um, say), source.path);
  } else if (!png) {
    const SensorReadings sensors(source);
    field = flat_field_of(sensors.image(), source.path);
    say.push_back(
        fmt::format("{} sensors of the printer's UV meter, {} rows of {}, scaled to the brightest; "
                    "which corner of the display comes first is not known.",
                    sensors.rows() * sensors.columns(), sensors.rows(), sensors.columns()));
  } else {
    field = flat_field_of_png(source.path);
    if (correction_mask) {
      field = light_behind(std::move(field.image), source.path);
      say.emplace_back(
          "A correction mask, which multiplies grey levels so that the light becomes even: "
          "relative intensity was taken as its least value over its value, which takes intensity "
          "to be proportional to grey level.");
    } else {
      say.emplace_back(
          "Grey levels of the image are relative intensity, white the brightest; the image covers "
          "the whole display.");
    }
  }
  if (png && !correction_mask) {
    image.bytes = source.text;
  } else {
    const auto encoded = encode_png(field.image);
    image.bytes.assign(encoded.begin(), encoded.end());
  }
  if (options.calibrated_at_mm.empty()) {
    say.emplace_back(
        "Its brightest place is taken to get the intensities of the calibration; where they were "
        "measured elsewhere, write the picture's value there as flat_field_reference (1 to 255).");
  }
  if (map) {
    edit.remove("display", "flat_field_reference");
    if (of_plate) {
      edit.set("display", "flat_field_frame", toml_text("plate"));
    } else {
      edit.remove("display", "flat_field_frame");
    }
  } else if (plugs) {
    edit.remove("display", "flat_field_reference");
    edit.set("display", "flat_field_frame", toml_text("plate"));
  } else {
    set_frame(edit, field.image, source.path, made);
    if (options.frame == "plate") edit.set("display", "flat_field_frame", toml_text("plate"));
    if (options.frame == "image") edit.remove("display", "flat_field_frame");
  }
  if (!options.calibrated_at_mm.empty()) {
    if (!map) {
      throw InputError(source.path, "",
                       "is a picture; the place of the calibration is for readings with places; "
                       "expected flat_field_reference in the printer file");
    }
    const double x_mm = options.calibrated_at_mm.at(0), y_mm = options.calibrated_at_mm.at(1);
    const double value = std::clamp(map->value_at(x_mm, y_mm), 1.0, 255.0);
    edit.set("display", "flat_field_reference", std::to_string(std::lround(value)));
    say.push_back(
        fmt::format("The calibration holds at x = {:g}, y = {:g} mm, where the light is "
                    "{:.0f} % of the brightest.",
                    x_mm, y_mm, value / 2.55));
  }
  edit.set("display", "flat_field", toml_text(image.stem + image.extension));
  std::string comment = fmt::format("# Relative intensity over the display, from {}.", source.file);
  for (const std::string& a : say) comment += "\n# - " + a;
  edit.set_comment("display", "flat_field", comment);
  edit.set("display", "flat_field_least", toml_number(field.least, 4));
  edit.set("display", "flat_field_mean", toml_number(field.mean, 4));
  edit.set("provenance", "flat_field",
           toml_text(fmt::format("{}, {} x {} values", source.file, field.image.width_px,
                                 field.image.height_px)));
  made.text = edit.text();
  made.attachments.push_back(std::move(image));
  parse_display(made.text, made.name + ".toml");
  return {made};
}

}  // namespace slicecorr::resins
