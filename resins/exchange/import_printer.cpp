// Measurements of a printer: its calibration curve, and how even its light is.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <sstream>

#include "database/flat_field.hpp"
#include "database/toml_edit.hpp"
#include "exchange/csv.hpp"
#include "exchange/import.hpp"
#include "support/toml/toml_table.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/process.hpp"

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

/// Makes intensities rise: neighbours that fall are put to their mean (isotonic least squares).
/// Returns the greatest change.
double make_rising(std::vector<CalibrationPoint>& points) {
  struct Block {
    double sum = 0;
    std::size_t count = 0;
    double mean() const { return sum / static_cast<double>(count); }
  };
  std::vector<Block> blocks;
  for (const CalibrationPoint& p : points) {
    blocks.push_back({p.intensity_mw_cm2, 1});
    while (blocks.size() > 1 && blocks[blocks.size() - 2].mean() > blocks.back().mean()) {
      const Block last = blocks.back();
      blocks.pop_back();
      blocks.back().sum += last.sum;
      blocks.back().count += last.count;
    }
  }
  double greatest = 0;
  std::size_t i = 0;
  for (const Block& b : blocks) {
    for (std::size_t k = 0; k < b.count; ++k, ++i) {
      // A block of one keeps its number to the last bit.
      const double value = b.count == 1 ? points[i].intensity_mw_cm2 : b.mean();
      greatest = std::max(greatest, std::abs(points[i].intensity_mw_cm2 - value));
      points[i].intensity_mw_cm2 = value;
    }
  }
  return greatest;
}

std::string calibration_array(const std::vector<CalibrationPoint>& points) {
  std::string out = "[";
  for (std::size_t i = 0; i < points.size(); ++i) {
    out += fmt::format("{}[{:g}, {}],", i % 6 == 0 ? "\n  " : " ", points[i].level,
                       toml_number(points[i].intensity_mw_cm2));
  }
  return out + "\n]";
}

/// Values of uvSensorData: 60 sensors of the Prusa SL1's UV meter, 6 rows of 10.
GreyImage sensor_image(const ImportSource& source) {
  constexpr int columns = 10, rows = 6;
  const toml::table root = parse_toml(source.text, source.path);
  const auto* data = root.get("uvSensorData") ? root.get("uvSensorData")->as_array() : nullptr;
  if (!data || data->size() != columns * rows) {
    throw InputError(
        source.path, "uvSensorData",
        fmt::format("expected {} numbers, {} rows of {}", columns * rows, rows, columns));
  }
  std::vector<double> values;
  for (const auto& node : *data) {
    const auto value = node.is_number() ? node.value<double>() : std::nullopt;
    if (!value || !std::isfinite(*value) || *value < 0) {
      throw InputError(source.path, fmt::format("line {}: uvSensorData", node.source().begin.line),
                       "expected numbers of at least 0");
    }
    values.push_back(*value);
  }
  const double greatest = *std::max_element(values.begin(), values.end());
  GreyImage image{columns, rows, {}};
  for (const double v : values) {
    image.pixels.push_back(
        static_cast<std::uint8_t>(greatest > 0 ? std::lround(v / greatest * 255) : 0));
  }
  return image;
}

}  // namespace

std::vector<Imported> import_calibration(const ImportSource& source, const ImportOptions& options,
                                         const char* lamp) {
  Imported made;
  made.kind = "printer";
  TomlEdit edit = printer_text(source, options, made.name);
  const CsvTable table(source.text, source.path);
  if (table.header().size() != 2) {
    throw InputError(
        source.path, "header",
        fmt::format("has {} columns; expected two: grey level, mW/cm²", table.header().size()));
  }
  std::vector<CalibrationPoint> points;
  const auto add = [&](double level, double intensity) { points.push_back({level, intensity}); };
  // A table of numbers alone has no header: its first row is data.
  const auto level = number_in_text(table.header()[0]);
  const auto intensity = number_in_text(table.header()[1]);
  if (level && intensity) add(*level, *intensity);
  for (const CsvTable::Row& row : table.rows()) {
    const auto l = table.number(row, table.header()[0]), v = table.number(row, table.header()[1]);
    if (!l || !v) table.fail(row, table.header()[l ? 1 : 0], "is empty; expected a number");
    if (*v < 0) table.fail(row, table.header()[1], fmt::format("is {:g}; expected at least 0", *v));
    add(*l, *v);
  }
  if (points.size() < 2) {
    throw InputError(source.path, "", "has fewer than two points; expected a curve");
  }
  std::stable_sort(points.begin(), points.end(),
                   [](const auto& a, const auto& b) { return a.level < b.level; });
  const std::size_t read = points.size();
  // Readings of the same level are averaged.
  std::vector<CalibrationPoint> curve;
  for (std::size_t i = 0; i < points.size();) {
    std::size_t end = i;
    double sum = 0;
    while (end < points.size() && points[end].level == points[i].level) {
      sum += points[end++].intensity_mw_cm2;
    }
    curve.push_back({points[i].level, sum / static_cast<double>(end - i)});
    i = end;
  }
  auto& say = made.assumptions;
  say.push_back(
      fmt::format("Intensities are those at the window, mW/cm², between points a straight "
                  "line; {} readings at {} levels.",
                  read, curve.size()));
  if (curve.size() < read) say.emplace_back("Readings of the same level were averaged.");
  const double top = curve.back().intensity_mw_cm2;
  const double changed = make_rising(curve);
  if (changed > 0) {
    // What a meter scatters is smoothed; a curve that really falls must be looked at.
    constexpr double most = 0.02;
    if (changed > most * top) {
      throw InputError(source.path, "",
                       fmt::format("the curve falls: making it rise would change a reading by {:g} "
                                   "mW/cm², more than {:g} % of full light; expected a curve that "
                                   "rises with the grey level",
                                   changed, most * 100));
    }
    say.push_back(
        fmt::format("Readings that fell were put to the mean of their neighbours; greatest change "
                    "{:.3g} mW/cm².",
                    changed));
  }
  std::string comment =
      fmt::format("# {}, mW/cm² at the window, from {}.",
                  std::string_view(lamp) == "uv" ? "Control value" : "Grey level", source.file);
  for (const std::string& a : say) comment += "\n# - " + a;
  edit.set(lamp, "calibration", calibration_array(curve));
  edit.set_comment(lamp, "calibration", comment);
  if (options.wavelength_nm > 0) {
    edit.set(lamp, "wavelength_nm", toml_number(options.wavelength_nm));
  }
  edit.set("provenance", std::string_view(lamp) == "uv" ? "uv_measurements" : "measurements",
           toml_text(fmt::format("calibration measured, {} readings, {}", read, source.file)));
  made.text = edit.text();
  parse_printer(made.text, made.name + ".toml");
  return {made};
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
  if (!png) {
    field = flat_field_of(sensor_image(source), source.path);
    say.emplace_back(
        "60 sensors of the printer's UV meter, 6 rows of 10, scaled to the brightest; "
        "which corner of the display comes first is not known.");
  } else {
    field = flat_field_of_png(source.path);
    if (correction_mask) {
      std::uint8_t least = 255;
      for (const std::uint8_t v : field.image.pixels) least = std::min(least, v);
      if (least == 0) {
        throw InputError(source.path, "",
                         "has black pixels: as a correction that would mean endless light there; "
                         "expected a mask above 0");
      }
      for (std::uint8_t& v : field.image.pixels) {
        v = static_cast<std::uint8_t>(std::lround(255.0 * least / v));
      }
      field = flat_field_of(std::move(field.image), source.path);
      say.emplace_back(
          "A correction mask, which multiplies grey levels so that the light becomes "
          "even: relative intensity was taken as its least value over its value, which "
          "takes intensity to be proportional to grey level.");
    } else {
      say.emplace_back(
          "Grey levels of the image are relative intensity, white the brightest; the "
          "image covers the whole display.");
    }
  }
  if (png && !correction_mask) {
    image.bytes = source.text;
  } else {
    const auto encoded = encode_png(field.image);
    image.bytes.assign(encoded.begin(), encoded.end());
  }
  say.emplace_back(
      "Its brightest place is taken to get the intensities of the calibration; where they were "
      "measured elsewhere, write the picture's value there as flat_field_reference (1 to 255).");
  // Maps that lie across a portrait display can only be maps of the plate.
  const Printer printer = parse_printer(edit.text(), made.name + ".toml");
  edit.remove("display", "flat_field_reference");
  slicecorr::FlatField map;
  map.width_px = field.image.width_px;
  map.height_px = field.image.height_px;
  try {
    check_flat_field(map, printer, source.path);
    edit.remove("display", "flat_field_frame");
  } catch (const InputError&) {
    map.of_plate = true;
    try {
      check_flat_field(map, printer, source.path);
    } catch (const InputError&) {
      map.of_plate = false;
    }
    if (!map.of_plate) throw;
    edit.set("display", "flat_field_frame", toml_text("plate"));
    say.emplace_back(
        "It lies across the images of the display, which are portrait: it was taken for one of the "
        "plate, its first row at the largest y, its first column at the smallest x.");
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
  parse_printer(made.text, made.name + ".toml");
  return {made};
}

}  // namespace slicecorr::resins
