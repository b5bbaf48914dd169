// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/tomo/targets.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "picture/sheet.hpp"
#include "slicecorr/cure.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/vial.hpp"

namespace slicecorr::tomo {

namespace {

constexpr int kLeastSide = 64;

using slicecorr::detail::Sheet;

Sheet sheet_of(const Printer& p) { return {p.width_px, p.height_px}; }

/// As the projector shows it: the levels nearest to its shares of the greatest.
GreyImage image_of(const Sheet& sheet, const Printer& printer) {
  GreyImage image{sheet.width(), sheet.height(), {}};
  const int levels = printer.levels();
  for (const float share : sheet.light()) {
    const int level = static_cast<int>(std::lround(share * static_cast<float>(levels - 1)));
    image.pixels.push_back(static_cast<std::uint8_t>(pixel_of_level(level, levels)));
  }
  return image;
}

/// Size of letters that fit a projector of this size.
int letter_scale(const Printer& p) {
  return std::clamp(std::min(p.width_px, p.height_px) / 300, 1, 6);
}

/// Columns over the vial's width, and rows about the optical axis that show it as high as wide.
struct Window {
  int first = 0, past = 0, top = 0, bottom = 0;
  double axis = 0, middle = 0;  ///< column of the axis, row of the optical axis
};
Window window_of(const Printer& p) {
  const ImagePlace at = image_place(p, {0, 0});
  const double columns = p.vial->outside_mm() / (p.pixel_x_um * 1e-3);
  Window w;
  w.axis = at.column;
  w.middle = at.row;
  w.first = std::clamp(static_cast<int>(std::floor(at.column - columns)), 0, p.width_px);
  w.past = std::clamp(static_cast<int>(std::ceil(at.column + columns)) + 1, 0, p.width_px);
  w.top = 0;
  w.bottom = p.height_px;
  return w;
}

void draw_axis(const Printer& p, Sheet& s) {
  const double pitch = p.pixel_y_um * 1e-3;
  for (int row = 0; row < s.height(); ++row) {
    // The axis is so high here; with a tilt its column changes from row to row.
    const double up = (image_place(p, {0, 0}).row - row) * pitch;
    const double tilt = p.optics->tilt_deg * std::numbers::pi / 180;
    s.share_column(image_place(p, {0, up / std::cos(tilt)}).column, row);
  }
}

std::vector<TargetPicture> axis_pictures(const Printer& p) {
  const Window w = window_of(p);
  const int scale = letter_scale(p);
  Sheet cross = sheet_of(p);
  draw_axis(p, cross);
  for (int column = 0; column < cross.width(); ++column) cross.share_row(column, w.middle);
  Sheet comb = sheet_of(p);
  // Teeth reach all the way up, so that a pin shows one at any height.
  for (int column = 0; column < comb.width(); column += 10) {
    comb.fill(column, 0, column % 100 ? 1 : 3, comb.height());
  }
  for (int column = 0; column < comb.width(); column += 100) {
    for (const int sixth : {1, 3, 5}) {
      comb.label(column + 5, sixth * comb.height() / 6, fmt::format("{}", column), scale);
    }
  }
  return {
      {"axis-cross", "the axis of rotation as the printer file has it, and the optical axis",
       image_of(cross, p)},
      {"axis-comb", "a line each 10 columns, thicker with its number each 100", image_of(comb, p)}};
}

std::vector<TargetPicture> focus_pictures(const Printer& p) {
  Sheet s = sheet_of(p);
  const Window w = window_of(p);
  const int scale = letter_scale(p);
  const int across = std::max(40, w.past - w.first);
  const int radius = std::min({across / 3, s.height() / 4, s.width() / 4});
  const int cx = static_cast<int>(std::lround(w.axis));
  const int cy = std::clamp(static_cast<int>(std::lround(w.middle)), radius, s.height() - radius);
  for (int y = -radius; y <= radius; ++y) {
    for (int x = -radius; x <= radius; ++x) {
      const double r = std::hypot(x, y);
      if (r > radius) continue;
      constexpr int spokes = 36;
      const double turn = std::atan2(y, x) / (2 * std::numbers::pi) * spokes;
      if (turn - std::floor(turn) < 0.5) s.set(cx + x, cy + y, 1);
    }
  }
  // Line pairs above the star, of lines across, and below it, of lines up and down.
  const int tall = std::max(8, radius / 2), wide = std::max(8, radius / 3 - 6 * scale);
  for (const bool upright : {true, false}) {
    int at = cx - radius;
    for (const int width : {1, 2, 3, 4, 6, 8}) {
      constexpr int lines = 5;
      const int size = (2 * lines - 1) * width;
      const int row = upright ? cy - radius - tall - 12 * scale : cy + radius + 4 * scale;
      for (int k = 0; k < lines; ++k) {
        if (upright) s.fill(at + 2 * k * width, row, width, tall);
        if (!upright) s.fill(at, row + 2 * k * width, wide, width);
      }
      s.words(at, row + (upright ? tall : 72) + 3 * scale, fmt::format("{}", width), scale);
      at += std::max(upright ? size : wide, 7 * scale) + 6 * scale;
    }
  }
  return {{"focus", "a star of 36 spokes, and line pairs of 1 to 8 pixels", image_of(s, p)}};
}

std::vector<TargetPicture> scale_pictures(const Printer& p) {
  Sheet s = sheet_of(p);
  const int scale = letter_scale(p);
  for (int column = 0; column < s.width(); column += 10) {
    s.fill(column, 0, column % 100 ? 1 : 3, column % 50 ? 6 : s.height());
  }
  for (int row = 0; row < s.height(); row += 10) {
    s.fill(0, row, row % 50 ? 6 : s.width(), row % 100 ? 1 : 3);
  }
  for (int column = 0; column < s.width(); column += 100) {
    s.label(column + 5, 10, fmt::format("{}", column), scale);
  }
  for (int row = 100; row < s.height(); row += 100) {
    s.label(10, row + 5, fmt::format("{}", row), scale);
  }
  return {{"scale", "a line each 50 columns and rows, thicker with its number each 100",
           image_of(s, p)}};
}

std::vector<TargetPicture> direction_pictures(const Printer& p) {
  std::vector<TargetPicture> all;
  const Window w = window_of(p);
  const double pitch = p.pixel_x_um * 1e-3;
  const bool clockwise = p.rotation->direction == TurnDirection::clockwise;
  for (const int angle : {0, 90, 180, 270}) {
    Sheet s = sheet_of(p);
    // A pin that faces the projector goes to the left when the vial turns clockwise.
    const int side = angle % 180 == 0 ? 0 : (angle == 90) == clockwise ? -1 : 1;
    double from = -0.3, to = 0.3;  // of the inner radius
    if (side < 0) from = -1.2, to = -0.3;
    if (side > 0) from = 0.3, to = 1.2;
    const double radius = p.vial->inner_mm / pitch;
    const int first = static_cast<int>(std::lround(w.axis + from * radius));
    const int past = static_cast<int>(std::lround(w.axis + to * radius));
    s.fill(first, s.height() / 3, past - first, s.height() - s.height() / 3);
    // An F is no letter in a mirror, and none upside down.
    const int scale = std::max(1, s.height() / 40);
    const std::string text = fmt::format("F {}", angle);
    s.words(static_cast<int>(w.axis) - Sheet::width_of(text, scale) / 2, s.height() / 20, text,
            scale);
    all.push_back({fmt::format("direction-{:03}", angle),
                   fmt::format("a bar {} when the stage has turned by {} degrees",
                               side < 0   ? "to the left"
                               : side > 0 ? "to the right"
                                          : "in the middle",
                               angle),
                   image_of(s, p)});
  }
  return all;
}

std::vector<TargetPicture> light_pictures(const Printer& p) {
  std::vector<TargetPicture> all;
  constexpr int steps = 8;
  int last = -1;
  for (int k = 0; k <= steps; ++k) {
    const int level =
        static_cast<int>(std::lround(static_cast<double>(k) / steps * (p.levels() - 1)));
    if (level == last) continue;
    last = level;
    const auto pixel = static_cast<std::uint8_t>(pixel_of_level(level, p.levels()));
    GreyImage image{
        p.width_px, p.height_px,
        std::vector<std::uint8_t>(
            static_cast<std::size_t>(p.width_px) * static_cast<std::size_t>(p.height_px), pixel)};
    all.push_back({fmt::format("light-{:03}", level),
                   fmt::format("level {} of {} everywhere", level, p.levels() - 1),
                   std::move(image)});
  }
  return all;
}

constexpr int kColumnsOfTime = 8;

/// Picture k lights the columns whose time is not over; all pictures one after the other make the matrix.
std::vector<TargetPicture> dose_pictures(const Printer& p) {
  const std::vector<int> levels = target_levels(p);
  const auto rows = static_cast<int>(levels.size());
  // Within the vial's width, where a cuvette would stand: squares with gaps of half of one.
  const Window w = window_of(p);
  const int across =
      std::max(kLeastSide, std::min({w.past - w.first, p.width_px, p.height_px * 9 / 10}));
  const int side = std::max(1, across * 2 / (3 * std::max(kColumnsOfTime, rows)));
  const int step = side + std::max(1, side / 2);
  const int left = static_cast<int>(std::lround(w.axis)) - step * kColumnsOfTime / 2;
  const int top = std::clamp(static_cast<int>(std::lround(w.middle)) - step * rows / 2, 0,
                             std::max(0, p.height_px - step * rows));
  std::vector<TargetPicture> all;
  for (int k = 0; k < kColumnsOfTime; ++k) {
    GreyImage image{p.width_px, p.height_px, {}};
    image.pixels.assign(
        static_cast<std::size_t>(p.width_px) * static_cast<std::size_t>(p.height_px), 0);
    for (int r = 0; r < rows; ++r) {
      const auto value = static_cast<std::uint8_t>(
          pixel_of_level(levels[static_cast<std::size_t>(r)], p.levels()));
      for (int c = k; c < kColumnsOfTime; ++c) {
        for (int y = top + r * step; y < std::min(top + r * step + side, p.height_px); ++y) {
          for (int x = std::max(0, left + c * step);
               x < std::min(left + c * step + side, p.width_px); ++x) {
            image.pixels[static_cast<std::size_t>(y) * static_cast<std::size_t>(p.width_px) +
                         static_cast<std::size_t>(x)] = value;
          }
        }
      }
    }
    all.push_back({fmt::format("dose-{}", k + 1),
                   fmt::format("columns {} to {}, rows of {} levels", k + 1, kColumnsOfTime, rows),
                   std::move(image)});
  }
  return all;
}

std::vector<TargetPicture> threshold_pictures(const Printer& p) {
  const std::vector<int> levels = target_levels(p);
  const auto discs = static_cast<int>(levels.size());
  const int step = p.height_px / discs;
  const double radius = step / 4.0;
  GreyImage image{p.width_px, p.height_px, {}};
  for (int row = 0; row < p.height_px; ++row) {
    const int k = std::min(row / step, discs - 1);
    const double up = ((p.height_px - 1) / 2.0 - row - p.optics->axis_up_px) * p.pixel_y_um * 1e-3;
    const double axis = image_place(p, {0, up}).column;
    const auto value =
        static_cast<std::uint8_t>(pixel_of_level(levels[static_cast<std::size_t>(k)], p.levels()));
    for (int column = 0; column < p.width_px; ++column) {
      const bool lit = std::hypot(column - axis, row - (k + 0.5) * step) <= radius;
      image.pixels.push_back(lit ? value : 0);
    }
  }
  return {{"threshold", fmt::format("{} discs on the axis, the brightest at the top", discs),
           std::move(image)}};
}

}  // namespace

std::vector<int> target_levels(const Printer& printer) {
  constexpr int most = 8;
  const std::vector<double> light = level_intensities(printer);
  std::vector<int> levels;
  for (int k = 0; k < most; ++k) {
    const double wanted = light.back() * std::pow(0.1, k / (most - 1.0));
    const auto at = std::lower_bound(light.begin(), light.end(), wanted);
    const auto level = static_cast<int>(
        std::min(at - light.begin(), static_cast<std::ptrdiff_t>(light.size()) - 1));
    if (level > 0 && (levels.empty() || level < levels.back())) levels.push_back(level);
  }
  return levels;
}

std::vector<double> target_times() {
  std::vector<double> times;
  times.reserve(kColumnsOfTime);
  for (int k = 0; k < kColumnsOfTime; ++k) times.push_back(0.5 * std::pow(20.0, k / 7.0));
  return times;
}

std::vector<TargetPicture> target_pictures(TargetKind kind, const Printer& printer) {
  require_tomographic(printer);
  if (printer.width_px < kLeastSide || printer.height_px < kLeastSide) {
    throw InputError(fmt::format(
        "printer '{}' shows {} x {} pixels; expected {} a side at least, which a target needs",
        printer.name, printer.width_px, printer.height_px, kLeastSide));
  }
  switch (kind) {
    case TargetKind::axis:
      return axis_pictures(printer);
    case TargetKind::focus:
      return focus_pictures(printer);
    case TargetKind::scale:
      return scale_pictures(printer);
    case TargetKind::direction:
      return direction_pictures(printer);
    case TargetKind::dose:
      return dose_pictures(printer);
    case TargetKind::threshold:
      return threshold_pictures(printer);
    case TargetKind::light:
      break;
  }
  return light_pictures(printer);
}

}  // namespace slicecorr::tomo
