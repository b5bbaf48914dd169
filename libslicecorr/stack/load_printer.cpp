// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Printer files with the picture of their flat-field; here because images are read in this module.
#include "slicecorr/load_printer.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cstring>
#include <filesystem>

#include "process/flat_field_keys.hpp"
#include "process/spread_keys.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/image_size.hpp"
#include "slicecorr/load_display.hpp"
#include "slicecorr/stack.hpp"
#include "stack/png/png.hpp"
#include "support/text/csv.hpp"
#include "support/toml/toml_table.hpp"

namespace slicecorr {

namespace {

namespace fs = std::filesystem;

/// Width or height in the header of a PNG.
std::uint32_t big_endian(const std::vector<std::uint8_t>& bytes, std::size_t at) {
  return (std::uint32_t{bytes[at]} << 24) | (std::uint32_t{bytes[at + 1]} << 16) |
         (std::uint32_t{bytes[at + 2]} << 8) | bytes[at + 3];
}

/// A file that looks like a PNG of a size that can be borne.
struct PngFile {
  std::vector<std::uint8_t> bytes;
  int width = 0, height = 0;
};
PngFile read_png_file(const std::string& path) {
  const std::string text = read_text_file(path);
  PngFile file{{text.begin(), text.end()}, 0, 0};
  constexpr std::uint8_t signature[] = {0x89, 'P', 'N', 'G', '\r', '\n', 0x1A, '\n'};
  if (file.bytes.size() < 24 || std::memcmp(file.bytes.data(), signature, sizeof signature) != 0) {
    throw InputError(path, "", "is no PNG image");
  }
  const std::uint32_t width = big_endian(file.bytes, 16), height = big_endian(file.bytes, 20);
  if (!is_image_size(width, height)) {
    throw InputError(path, "",
                     fmt::format("is {} x {} pixels; expected sides of 1 to {} and at most {} "
                                 "pixels",
                                 width, height, kMostPixelsAcross, kMostPixels));
  }
  file.width = static_cast<int>(width);
  file.height = static_cast<int>(height);
  return file;
}

/// `what` names the image in complaints.
GreyImage read_grey_png(const std::string& path, const char* what,
                        const std::function<void(int width_px, int height_px)>& check) {
  const PngFile file = read_png_file(path);
  if (check) check(file.width, file.height);
  return decode_png(file.bytes, file.width, file.height, path, what);
}

/// A file that a table names, beside `source` where its name is relative.
std::string file_beside(const TomlTable& table, const char* key, const std::string& name) {
  fs::path file = name;
  if (file.is_relative()) file = fs::path(table.source()).parent_path() / file;
  std::error_code ec;
  if (!fs::is_regular_file(file, ec)) {
    table.fail(key, fmt::format("{} is not a file that can be read", file.string()));
  }
  return file.string();
}

/// The picture that [blue] or [uv] names as spread.
std::optional<SpreadPicture> spread_picture(const TomlTable& light, const Printer& printer) {
  const detail::SpreadKeys keys = detail::spread_keys(light, printer);
  if (keys.file.empty()) return std::nullopt;
  const std::string path = file_beside(light, "spread", keys.file);
  try {
    SpreadPicture picture;
    picture.pitch_um = keys.pitch_um;
    GreyImage image = read_grey_png(path, "spread", [&](int width_px, int height_px) {
      if (std::max(width_px, height_px) > kMostSpreadPixels) {
        throw InputError(path, "",
                         fmt::format("is {} x {} pixels; expected at most {} along each side",
                                     width_px, height_px, kMostSpreadPixels));
      }
      picture.width_px = width_px;
      picture.height_px = height_px;
      check_spread_picture(picture, printer, path);
    });
    picture.values = std::make_shared<const std::vector<std::uint8_t>>(std::move(image.pixels));
    check_spread_picture(picture, printer, path);
    return picture;
  } catch (const InputError& e) {
    light.fail("spread", e.what());
  }
}

}  // namespace

GreyImage read_flat_field_png(const std::string& path,
                              const std::function<void(int width_px, int height_px)>& check) {
  return read_grey_png(path, "flat-field", check);
}

CameraPicture read_camera_png(const std::string& path) {
  const PngFile file = read_png_file(path);
  const std::string what = "picture";
  return detail::decode_camera_png(file.bytes, file.width, file.height, {path, what});
}

void check_flat_field(const FlatField& field, const Printer& printer, const std::string& path) {
  Grid covered;
  if (field.of_plate) {
    covered = plate_grid(printer);
  } else {
    covered.width_px = printer.width_px;
    covered.height_px = printer.height_px;
  }
  // More pixels than the display has are of no use, but pictures as large as cameras take are
  // borne.
  constexpr std::int64_t of_cameras = 100'000'000;
  const std::int64_t most =
      std::max(of_cameras, std::int64_t{printer.width_px} * printer.height_px);
  if (std::int64_t{field.width_px} * field.height_px > most) {
    throw InputError(
        path, "",
        fmt::format("is {} x {} pixels; expected at most {} of them for a display of {} x {}",
                    field.width_px, field.height_px, most, printer.width_px, printer.height_px));
  }
  const auto along = [](int w, int h) { return (w > h) - (w < h); };
  const int is = along(field.width_px, field.height_px);
  const int wanted = along(covered.width_px, covered.height_px);
  constexpr int fine = 64;
  const double shape = 1.0 * field.width_px * covered.height_px;
  const double shape_wanted = 1.0 * field.height_px * covered.width_px;
  const bool off = field.width_px >= fine && field.height_px >= fine &&
                   std::abs(shape - shape_wanted) > 0.02 * shape_wanted;
  if (off || is * wanted < 0) {
    throw InputError(
        path, "",
        fmt::format("is {} x {} pixels; expected a picture in the shape of the {}, {} x {} pixels, "
                    "that covers all of it",
                    field.width_px, field.height_px, field.of_plate ? "plate" : "display",
                    covered.width_px, covered.height_px));
  }
}

FlatField load_flat_field(const std::string& path, const Printer& printer, bool of_plate,
                          std::optional<int> reference) {
  FlatField field;
  field.of_plate = of_plate;
  GreyImage image = read_flat_field_png(path, [&](int width_px, int height_px) {
    field.width_px = width_px;
    field.height_px = height_px;
    check_flat_field(field, printer, path);
  });
  field.values = std::make_shared<const std::vector<std::uint8_t>>(std::move(image.pixels));
  if (field.greatest() == 0) {
    throw InputError(path, "", "is black; expected relative intensity, white the brightest");
  }
  field.reference = reference.value_or(field.greatest());
  return field;
}

namespace {

/// A lamp's light by its distance from the middle of the display, as a picture of at most a quarter of a
/// million pixels.
FlatField field_of_rings(const std::vector<detail::LampFieldKeys::Ring>& rings,
                         const Printer& printer) {
  constexpr double kMostAcross = 500;
  const double shrink = std::max(1.0, std::max(printer.width_px, printer.height_px) / kMostAcross);
  FlatField field;
  field.width_px = std::max(1, static_cast<int>(std::lround(printer.width_px / shrink)));
  field.height_px = std::max(1, static_cast<int>(std::lround(printer.height_px / shrink)));
  std::vector<std::uint8_t> values;
  for (int y = 0; y < field.height_px; ++y) {
    for (int x = 0; x < field.width_px; ++x) {
      const double u = (x + 0.5) / field.width_px - 0.5, v = (y + 0.5) / field.height_px - 0.5;
      const double r_mm = 1e-3 * std::hypot(u * printer.width_px * printer.pixel_x_um,
                                            v * printer.height_px * printer.pixel_y_um);
      double share = rings.back().share;
      for (std::size_t i = 1; i < rings.size(); ++i) {
        const auto& a = rings[i - 1];
        const auto& b = rings[i];
        if (r_mm > b.r_mm) continue;
        share = a.share + (r_mm - a.r_mm) / (b.r_mm - a.r_mm) * (b.share - a.share);
        break;
      }
      values.push_back(static_cast<std::uint8_t>(std::clamp(std::lround(255 * share), 1L, 255L)));
    }
  }
  field.values = std::make_shared<const std::vector<std::uint8_t>>(std::move(values));
  return field;
}

void take_lamp_field(const TomlTable& uv, Printer& printer) {
  const detail::LampFieldKeys keys = detail::lamp_field_keys(uv);
  if (!keys.rings.empty()) {
    printer.uv_flat_field = field_of_rings(keys.rings, printer);
  } else if (keys.picture) {
    const std::string file = file_beside(uv, "flat_field", keys.picture->file);
    try {
      printer.uv_flat_field =
          load_flat_field(file, printer, keys.picture->of_plate, keys.picture->reference);
    } catch (const InputError& e) {
      uv.fail("flat_field", e.what());
    }
  }
  if (printer.uv_flat_field && printer.uv_flat_field->least() == 0) {
    uv.fail("flat_field", "is black somewhere; expected UV light at all places");
  }
}

constexpr const char* kDistortionHead[] = {"x_px", "y_px", "x_mm", "y_mm"};

/// A table of marks: image places in the first two columns, measured ones in the last two.
std::vector<DistortionPoint> read_marks(const std::string& path) {
  CsvReader reader = CsvReader::of_file(path, {.longest_line_bytes = 1000});
  const auto wrong = [&](const std::string& what) { throw InputError(path, reader.place(), what); };
  constexpr double kMost = 1e6;
  std::vector<DistortionPoint> points;
  bool head = true;
  for (CsvRow row; reader.next(row); head = false) {
    if (row.fault != CsvRow::Fault::none || row.cells.size() != std::size(kDistortionHead)) {
      wrong("expected four columns, x_px,y_px,x_mm,y_mm");
    }
    if (head) {
      if (!std::equal(row.cells.begin(), row.cells.end(), std::begin(kDistortionHead))) {
        wrong("expected the head x_px,y_px,x_mm,y_mm");
      }
      continue;
    }
    // A mark that nobody could measure.
    if (row.cells[2].empty() && row.cells[3].empty()) continue;
    double numbers[4] = {};
    for (std::size_t i = 0; i < row.cells.size(); ++i) {
      const auto number = number_in_text(row.cells[i]);
      if (!number || !(std::abs(*number) <= kMost)) {
        wrong(fmt::format("expected a number as {}", kDistortionHead[i]));
      }
      numbers[i] = *number;
    }
    points.push_back({numbers[0], numbers[1], numbers[2], numbers[3]});
  }
  return points;
}

void take_distortion(const TomlTable& display, Printer& printer) {
  const std::string name = display.text("distortion", "");
  if (name.empty()) return;
  if (printer.optics || printer.rotation) {
    display.fail("distortion",
                 "is not counted where a vial turns: calibrate the axis in its images ([rotation], "
                 "[optics]; resinctl fit-optics); expected none");
  }
  const std::string file = file_beside(display, "distortion", name);
  try {
    printer.distortion = fit_distortion(read_marks(file), printer);
  } catch (const InputError& e) {
    display.fail("distortion", e.what());
  }
  // A flat-field was measured where the light lands, and has it in it already.
  if (!display.has("flat_field")) printer.flat_field = light_by_pitch(*printer.distortion, printer);
}

/// `printer` with the pictures that its file names.
Printer with_pictures(Printer printer, std::string_view text, const std::string& source) {
  const toml::table root_table = parse_toml(text, source);
  const TomlTable root(root_table, source);
  printer.spread.picture = spread_picture(root.required_table("blue"), printer);
  if (const auto uv = root.table("uv")) printer.uv->spread.picture = spread_picture(*uv, printer);
  if (const auto uv = root.table("uv")) take_lamp_field(*uv, printer);
  const TomlTable display = root.required_table("display");
  take_distortion(display, printer);
  const auto keys = detail::flat_field_keys(display);
  if (!keys) return printer;
  const std::string file = file_beside(display, "flat_field", keys->file);
  try {
    printer.flat_field = load_flat_field(file, printer, keys->of_plate, keys->reference);
  } catch (const InputError& e) {
    display.fail("flat_field", e.what());
  }
  return printer;
}

}  // namespace

Printer complete_printer(std::string_view text, const std::string& source) {
  return with_pictures(parse_printer(text, source), text, source);
}

Printer load_display(const std::string& name_or_path) {
  const std::string path = find_definition(name_or_path, "printer");
  const std::string text = read_text_file(path);
  return with_pictures(parse_display(text, path), text, path);
}

Printer load_printer(const std::string& name_or_path) {
  const std::string path = find_definition(name_or_path, "printer");
  return complete_printer(read_text_file(path), path);
}

}  // namespace slicecorr
