// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/grid_part.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "measure/part_sheet.hpp"
#include "slicecorr/error.hpp"

namespace slicecorr {

using namespace page;

namespace {

/// Crosses along the longer and the shorter side of the plate, and how far the outermost are from its edge.
constexpr int kLong = 9, kShort = 7;
constexpr double kFromEdge = 0.06;
/// Their strokes: so long, and so wide, mm.
constexpr double kStrokeMm = 3, kWideMm = 0.25;
/// A cross takes up at most this share of the way to the next.
constexpr double kMostShare = 0.6;

}  // namespace

GridPart::GridPart(const Printer& printer, double layer_um, double image_s)
    : printer_name_(printer.name), grid_(plate_grid(printer)), image_s_(image_s) {
  if (!(layer_um > 0)) throw InputError("layers are 0 um high; expected more");
  if (!(image_s > 0)) throw InputError("images are shown for 0 s; expected more");
  grid_.layer_um = layer_um;
  grid_.layers = kImages;
  const double width_mm = 1e-3 * grid_.width_px * grid_.pixel_x_um;
  const double height_mm = 1e-3 * grid_.height_px * grid_.pixel_y_um;
  const bool wide = width_mm >= height_mm;
  const int across = wide ? kLong : kShort, down = wide ? kShort : kLong;
  const double step_mm =
      (1 - 2 * kFromEdge) * std::min(width_mm / (across - 1), height_mm / (down - 1));
  const double half_mm = 0.5 * std::min(kStrokeMm, kMostShare * step_mm);
  /// Half of a stroke in pixels of a side: a stroke has an odd number, so that its middle is a pixel's.
  const auto half_px = [](double mm, double um) {
    return static_cast<int>(std::floor(mm * 1e3 / um));
  };
  const int long_x = half_px(half_mm, grid_.pixel_x_um),
            long_y = half_px(half_mm, grid_.pixel_y_um);
  const int thick_x = half_px(0.5 * kWideMm, grid_.pixel_x_um),
            thick_y = half_px(0.5 * kWideMm, grid_.pixel_y_um);
  if (long_x < 2 * thick_x + 2 || long_y < 2 * thick_y + 2) {
    throw InputError(fmt::format(
        "printer '{}' shows {:.1f} x {:.1f} mm of the plate; expected room for {} x {} crosses",
        printer.name, width_mm, height_mm, across, down));
  }
  for (int j = 0; j < down; ++j) {
    for (int i = 0; i < across; ++i) {
      const auto place = [](int pixels, int n, int count) {
        return static_cast<int>(pixels * (kFromEdge + (1 - 2 * kFromEdge) * n / (count - 1)));
      };
      const int x = place(grid_.width_px, i, across), y = place(grid_.height_px, j, down);
      crosses_.push_back({x + 0.5,
                          y + 0.5,
                          {x - long_x, y - thick_y, x + long_x + 1, y + thick_y + 1},
                          {x - thick_x, y - long_y, x + thick_x + 1, y + long_y + 1}});
    }
  }
}

void GridPart::read_band(const PixelBox& band, const Sink& sink) const {
  std::vector<std::uint8_t> rows(static_cast<std::size_t>(band.width()) *
                                 static_cast<std::size_t>(band.height()));
  bool black = true;
  for (const Cross& cross : crosses_) {
    for (const PixelBox& stroke : {cross.across, cross.down}) {
      for (int y = std::max(stroke.y0, band.y0); y < std::min(stroke.y1, band.y1); ++y) {
        for (int x = std::max(stroke.x0, band.x0); x < std::min(stroke.x1, band.x1); ++x) {
          rows[static_cast<std::size_t>(y - band.y0) * static_cast<std::size_t>(band.width()) +
               static_cast<std::size_t>(x - band.x0)] = 255;
          black = false;
        }
      }
    }
  }
  for (int n = 0; n < grid_.layers; ++n) sink(n, black ? nullptr : rows.data());
}

MeasuringForm GridPart::form() const {
  MeasuringForm f;
  f.part = "grid";
  f.add_fact("width_px", grid_.width_px);
  f.add_fact("height_px", grid_.height_px);
  f.columns = {"x_px", "y_px", "x_mm", "y_mm"};
  f.known = 2;
  f.note =
      "Fill in x_mm and y_mm of the middle of each cross, y upwards, from any corner. Leave both empty where "
      "a cross is missing; change nothing else.";
  for (const Cross& cross : crosses_) {
    f.rows.push_back({fmt::format("{:g}", cross.x_px), fmt::format("{:g}", cross.y_px)});
  }
  return f;
}

std::string GridPart::sheet(const std::string& form_file, const std::string& printer_file) const {
  detail::PartSheet s;
  s.title = "Where pixels land, " + printer_name_;
  s.about =
      "Crosses all over the plate. Lenses and mirrors bend the grid that an image is; where the crosses really "
      "lie tells by how much, and slices are then made for it.";
  s.tools = {
      "A flat-bed scanner of 600 dpi or more, a measuring microscope, or a camera above them with a "
      "glass scale in the picture",
      "Gloves, and glasses against the printer's light"};
  s.steps = {
      markup(
          "Print the file so that the crosses stay where they cure: <b>{} images</b> of <b>{:g} s</b> each, on the "
          "platform as one layer, or on a sheet of glass that lies on the window with resin on it. Or lay paper "
          "on the window and photograph the light itself.",
          kImages, image_s_),
      "Do not peel the crosses off: what is moved tells nothing.",
      "Scan or photograph them as the plate lies, seen from the side of the part: what is on the right of the "
      "picture below is on the right. Straighten the picture of a camera by the scale, not by the crosses.",
      "Measure where the middle of each cross lies, in mm, y upwards. Any corner may be 0, and all of it may lie "
      "turned: shift and turn are taken out. Scale is not."};
  std::vector<detail::SheetBox> boxes;
  for (const Cross& cross : crosses_) {
    boxes.push_back({cross.across, 1, {}});
    boxes.push_back({cross.down, 1, {}});
  }
  s.picture = detail::plate_picture(grid_, boxes);
  s.caption =
      "The plate from above. Rows of the table go from the upper left cross to the right, then down.";
  s.heads = {"x, px", "y, px", "x and y, mm"};
  for (const auto& row : form().rows) s.rows.push_back(row);
  s.after = markup(
      "Write into <b>{}</b>, below [display]: <b>distortion = \"{}\"</b>. All that slices meshes for this "
      "printer counts it from then on; <b>slicecorr info</b> of a stack tells by how much places are off.",
      printer_file, form_file);
  return sheet_page(s);
}

}  // namespace slicecorr
