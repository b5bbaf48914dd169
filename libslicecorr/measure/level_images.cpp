// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/level_images.hpp"

#include <fmt/format.h>

#include <cmath>

#include "measure/part_sheet.hpp"
#include "measure/sheet_commands.hpp"
#include "slicecorr/cure.hpp"
#include "slicecorr/error.hpp"

namespace slicecorr {

using namespace page;

namespace {

/// Black, and levels that rise by a fifth, from a 32nd of the greatest on: between two of them a straight
/// line is near any power of the level, to g (g - 1) / 8 * 0.2^2 of the light for the power g.
constexpr int kRising = 20;
constexpr double kFirst = 8.0 / 255;

double wanted_share(int n) {
  return n == 0 ? 0 : std::pow(kFirst, static_cast<double>(kRising - n) / (kRising - 1));
}

constexpr const char* kNothingOnIt =
    "Take off vat and platform, so that nothing lies on the display and nothing can come down on the "
    "sensor. Where the printer insists on a vat, take one that is empty and clean; what you then "
    "measure is the light at its film, which is right, too.";
constexpr const char* kRead =
    "At each image wait until the reading stands still, and write it down; that of black, too, which "
    "is small: its light adds up over a whole print. Take off what the meter shows while the lamp is "
    "off.";

/// The images side by side, each with its number and level.
Markup swatches(const std::vector<int>& levels, const std::vector<std::uint8_t>& values) {
  constexpr int kSide = 44, kStep = 50, kInRow = 11, kRow = 84;
  const int rows = (static_cast<int>(levels.size()) + kInRow - 1) / kInRow;
  Markup svg = markup(
      R"(<svg viewBox="0 0 {0} {1}" width="{0}" height="{1}" role="img" aria-label="the images from the first to the last">)",
      kStep * kInRow, kRow * rows);
  for (std::size_t i = 0; i < levels.size(); ++i) {
    const int x = kStep * static_cast<int>(i % kInRow) + 1,
              y = kRow * static_cast<int>(i / kInRow) + 1, middle = x + kSide / 2;
    svg += markup(
        R"x(<rect x="{0}" y="{1}" width="{2}" height="{2}" fill="rgb({3},{3},{3})" stroke="#888"/><text text-anchor="middle" x="{4}" y="{5}" font-size="11">{6}</text><text text-anchor="middle" x="{4}" y="{7}" font-size="11">level {8}</text>)x",
        x, y, kSide, values[i], middle, y + kSide + 13, i + 1, y + kSide + 26, levels[i]);
  }
  return svg + markup("</svg>");
}

}  // namespace

LevelImages::LevelImages(const Printer& printer, const FileGreys& greys, const Ask& ask)
    : ask_(ask),
      printer_name_(printer.name),
      wavelength_nm_(printer.wavelength_nm),
      grid_(plate_grid(printer)) {
  if (!(ask.layer_um > 0)) throw InputError("layers are 0 um high; expected more");
  if (!(ask.image_s > 0)) throw InputError("images are shown for 0 s; expected more");
  const int top = printer.levels() - 1;
  std::vector<int> held;
  for (int level = 0; level <= top; ++level) {
    const int value = pixel_of_level(level, printer.levels());
    if (greys[static_cast<std::size_t>(value)] == value) held.push_back(level);
  }
  if (held.empty() || held.front() != 0 || held.back() != top) {
    throw InputError(fmt::format(
        "the archive holds {} of the {} grey levels of printer '{}', black and full light not both "
        "among them; expected both",
        held.size(), top + 1, printer.name));
  }
  for (int n = 0; n <= kRising; ++n) {
    const double wanted = top * wanted_share(n);
    int best = held.front();
    for (const int level : held) {
      if (std::abs(level - wanted) < std::abs(best - wanted)) best = level;
    }
    if (!levels_.empty() && best <= levels_.back()) continue;  // few levels
    levels_.push_back(best);
    values_.push_back(static_cast<std::uint8_t>(pixel_of_level(best, printer.levels())));
  }
  grid_.layer_um = ask.layer_um;
  grid_.layers = static_cast<int>(levels_.size());
}

void LevelImages::read_band(const PixelBox& band, const Sink& sink) const {
  std::vector<std::uint8_t> rows(static_cast<std::size_t>(band.width()) *
                                 static_cast<std::size_t>(band.height()));
  for (int n = 0; n < grid_.layers; ++n) {
    const std::uint8_t value = values_[static_cast<std::size_t>(n)];
    rows.assign(rows.size(), value);
    sink(n, value == 0 ? nullptr : rows.data());
  }
}

MeasuringForm LevelImages::form() const {
  MeasuringForm f;
  f.part = "levels";
  f.add_fact("width_px", grid_.width_px);
  f.add_fact("height_px", grid_.height_px);
  f.columns = {"level", "mw_cm2"};
  f.known = 1;
  f.note =
      "Fill in mw_cm2, mW/cm² at the window; leave empty what was not measured, but for the first "
      "and the last; change nothing else.";
  for (const int level : levels_) f.rows.push_back({fmt::format("{}", level)});
  return f;
}

std::string LevelImages::sheet(const std::string& form_file,
                               const std::string& printer_file) const {
  detail::PartSheet s;
  s.title = "Light of the grey levels, " + printer_name_;
  s.about =
      "What light each grey level gives at the window. Corrections are made of these numbers: "
      "nothing else of a printer matters as much, and no two displays are alike.";
  s.tools = {
      fmt::format("A power meter for {}, with a sensor smaller than the display, that tells "
                  "mW/cm² to two digits at full light and in the dark (0.01 mW/cm² or finer)",
                  wavelength_nm_ > 0 ? fmt::format("{:g} nm", wavelength_nm_)
                                     : "the wavelength of your printer, mostly 405 nm"),
      "Glasses against that light, and gloves"};
  s.steps = {
      kNothingOnIt,
      "Let the lamp be lit for some minutes if you can: cold lamps are brighter.",
      "Lay the sensor face down onto the middle of the display.",
      markup(
          "Print the file: <b>{} images</b>, each all of one grey, from black to full light, each "
          "lit for <b>{:g} s</b>. The printer's motor may do what it will.",
          levels_.size(), ask_.image_s),
      kRead,
      markup(
          "A display whose readings do not rise from image to image, or jump from nothing to "
          "full, shows no grey: write <b>bit_depth = 1</b> into a copy of the printer's file, and "
          "measure black and full light.")};
  s.picture = swatches(levels_, values_);
  s.caption = "The images in their order, with their levels.";
  s.heads = {"image", "level", "mW/cm²"};
  for (std::size_t i = 0; i < levels_.size(); ++i) {
    s.rows.push_back({fmt::format("{}", i + 1), fmt::format("{}", levels_[i])});
  }
  s.after = markup(
      "Copy the last column into <b>{}</b>. What was not measured stays empty, but the first and the "
      "last are needed. Change nothing else there.",
      form_file);
  s.commands = detail::commands_on("levels", form_file, printer_file, printer_name_);
  return sheet_page(s);
}

}  // namespace slicecorr
