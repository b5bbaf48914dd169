// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/films_part.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>

#include "measure/part_sheet.hpp"
#include "measure/sheet_commands.hpp"
#include "picture/sheet.hpp"
#include "slicecorr/cure.hpp"
#include "slicecorr/error.hpp"

namespace slicecorr {

using namespace page;

namespace {

/// Full light, for these numbers of images: each twice as long as the one before.
constexpr std::array kTimes = {1, 2, 4, 8, FilmsPart::kImages};
/// Full light for as long as it gets, in so many further squares: scatter, and light that is not even.
constexpr int kRepeats = 3;
/// Grey levels as shares of the greatest, each for all and for half of the images. Films of darker ones
/// are too thin, or none, and a layer that holds by its own exposure is brighter.
constexpr std::array kGreys = {0.9, 0.8, 0.7, 0.6, 0.5, 0.42, 0.34, 0.26};

/// Sides of squares in mm: as calipers like them, and down to what tweezers can hold.
constexpr double kMostSide = 8, kLeastSide = 2, kSideStep = 0.5;
/// Dark between squares, in sides: films must not join.
constexpr double kApart = 0.375;
/// Rows of dots of a number in the square's height.
constexpr int kDots = 20;

std::vector<int> held_levels(const Printer& printer, const FileGreys& greys) {
  std::vector<int> held;
  for (int level = 1; level < printer.levels(); ++level) {
    const int value = pixel_of_level(level, printer.levels());
    if (greys[static_cast<std::size_t>(value)] == value) held.push_back(level);
  }
  if (held.empty() || held.back() != printer.levels() - 1 || greys[0] != 0) {
    throw InputError(
        fmt::format("the archive does not hold black and full light of printer '{}'; "
                    "expected both",
                    printer.name));
  }
  return held;
}

/// The levels that are to be compared with the brightest one, falling.
std::vector<int> grey_levels(const std::vector<int>& held) {
  std::vector<int> greys;
  const int top = held.back();
  for (const double share : kGreys) {
    int best = held.front();
    for (const int level : held) {
      if (std::abs(level - share * top) < std::abs(best - share * top)) best = level;
    }
    if (best < (greys.empty() ? top : greys.back())) greys.push_back(best);
  }
  return greys;
}

constexpr const char* kPour =
    "Pour resin into the vat, 3 mm deep or more, stirred as you always do. Let it stand for a minute, "
    "at the temperature at which you print.";
constexpr const char* kPeel =
    "Pour the resin off, or lift the films out of it. Peel each film off the floor with tweezers, "
    "from an edge on; soft ones come off best after some minutes.";
constexpr const char* kBlot =
    "Blot both sides with a paper towel. Do not wash: solvent swells films. Do not cure them "
    "further.";
constexpr const char* kMeasure =
    "Measure the middle of each square, with as little force as the calipers take. The number that "
    "is cut out says which it is; seen from the other side it is mirrored.";
constexpr const char* kTwice =
    "Measure a square twice where you doubt. What has no film, or one too soft to measure, stays "
    "empty.";
constexpr const char* kNoPlatform =
    "Take off the platform, and let the motor run without it: films cure on the floor of the vat, and "
    "nothing may stir the resin. A printer that does not run without its platform can't make them.";

}  // namespace

FilmsPart::FilmsPart(const Printer& printer, const FileGreys& greys, const Ask& ask)
    : ask_(ask),
      printer_name_(printer.name),
      levels_(printer.levels()),
      grid_(plate_grid(printer)) {
  if (!(ask.layer_um > 0)) throw InputError("layers are 0 um high; expected more");
  if (!(ask.image_s > 0)) throw InputError("images are shown for 0 s; expected more");
  // Some formats round to milliseconds, and the table would say another time than the print has.
  const double ms = std::max(1.0, std::round(ask.image_s * 1e3));
  if (std::abs(ms - ask.image_s * 1e3) > 1e-6 * ms) {
    throw InputError(fmt::format(
        "images are shown for {:g} s; files say thousandths of a second: expected {:g} s, or another "
        "whole number of them",
        ask.image_s, ms * 1e-3));
  }
  const std::vector<int> held = held_levels(printer, greys), shown = grey_levels(held);
  const int top = held.back();
  greys_ = static_cast<int>(shown.size());
  // The longest full light comes first, last and between: light that falls to a side is seen.
  const auto add = [&](int level, int images) { squares_.push_back({level, images, {}}); };
  add(top, kImages);
  for (const int level : shown) add(level, kImages);
  add(top, kImages);
  for (std::size_t i = 0; i + 1 < kTimes.size(); ++i) add(top, kTimes[i]);
  for (const int level : shown) add(level, kImages / 2);
  for (int i = 1; i < kRepeats; ++i) add(top, kImages);

  const int count = static_cast<int>(squares_.size());
  const std::optional<Layout> found = layout_of(count);
  if (!found || std::min(found->side_x, found->side_y) < kDots) {
    throw InputError(fmt::format(
        "printer '{}' shows {:.1f} x {:.1f} mm of the plate; expected room for {} squares of at "
        "least {:g} mm and {} pixels, {:g} of a side apart",
        printer.name, 1e-3 * grid_.width_px * grid_.pixel_x_um,
        1e-3 * grid_.height_px * grid_.pixel_y_um, count, kLeastSide, kDots, kApart));
  }
  grid_.layer_um = ask.layer_um;
  grid_.layers = kImages;
  place(*found);
}

std::optional<FilmsPart::Layout> FilmsPart::layout_of(int count) const {
  // About half again as wide as high, or what else the plate has room for.
  std::vector<int> columns(static_cast<std::size_t>(count));
  std::iota(columns.begin(), columns.end(), 1);
  const double wanted = std::sqrt(1.5 * count);
  std::stable_sort(columns.begin(), columns.end(),
                   [&](int a, int b) { return std::abs(a - wanted) < std::abs(b - wanted); });
  for (double side = kMostSide; side >= kLeastSide; side -= kSideStep) {
    const auto px = [](double mm, double um) {
      return static_cast<int>(std::lround(mm * 1e3 / um));
    };
    for (const int n : columns) {
      const Layout l{px(side, grid_.pixel_x_um),
                     px(side, grid_.pixel_y_um),
                     px(side * kApart, grid_.pixel_x_um),
                     px(side * kApart, grid_.pixel_y_um),
                     n,
                     (count + n - 1) / n};
      if (l.width() <= grid_.width_px && l.height() <= grid_.height_px) return l;
    }
  }
  return std::nullopt;
}

void FilmsPart::place(const Layout& l) {
  side_x_ = l.side_x;
  side_y_ = l.side_y;
  const int left = (grid_.width_px - l.width()) / 2 + l.apart_x,
            top = (grid_.height_px - l.height()) / 2 + l.apart_y;
  // Numbers stand in a corner: calipers measure the middle.
  const int dot = std::max(1, std::min(side_x_, side_y_) / kDots);
  for (std::size_t i = 0; i < squares_.size(); ++i) {
    const int column = static_cast<int>(i) % l.columns, row = static_cast<int>(i) / l.columns;
    const int x = left + column * (l.side_x + l.apart_x), y = top + row * (l.side_y + l.apart_y);
    squares_[i].box = {x, y, x + l.side_x, y + l.side_y};
    bounds_ = bounds_.united(squares_[i].box);
    detail::Sheet number(side_x_, side_y_);
    number.words(2 * dot, 2 * dot, fmt::format("{}", i + 1), dot);
    auto& cut = cut_.emplace_back();
    for (const float light : number.light()) cut.push_back(light > 0);
  }
}

/// Adds the light of a square to rows of a band.
void FilmsPart::draw(std::size_t square, const PixelBox& band,
                     std::vector<std::uint8_t>& rows) const {
  const FilmSquare& s = squares_[square];
  const auto value = static_cast<std::uint8_t>(pixel_of_level(s.level, levels_));
  for (int y = std::max(s.box.y0, band.y0); y < std::min(s.box.y1, band.y1); ++y) {
    for (int x = std::max(s.box.x0, band.x0); x < std::min(s.box.x1, band.x1); ++x) {
      const auto at = static_cast<std::size_t>(y - s.box.y0) * static_cast<std::size_t>(side_x_) +
                      static_cast<std::size_t>(x - s.box.x0);
      if (cut_[square][at]) continue;
      rows[static_cast<std::size_t>(y - band.y0) * static_cast<std::size_t>(band.width()) +
           static_cast<std::size_t>(x - band.x0)] = value;
    }
  }
}

void FilmsPart::read_band(const PixelBox& band, const Sink& sink) const {
  std::vector<std::uint8_t> rows;
  bool black = true;
  for (int n = 0; n < grid_.layers; ++n) {
    const bool other = n == 0 || std::any_of(squares_.begin(), squares_.end(),
                                             [&](const FilmSquare& s) { return s.images == n; });
    if (other) {
      rows.assign(static_cast<std::size_t>(band.width()) * static_cast<std::size_t>(band.height()),
                  0);
      for (std::size_t i = 0; i < squares_.size(); ++i) {
        if (n < squares_[i].images) draw(i, band, rows);
      }
      black = std::all_of(rows.begin(), rows.end(), [](auto v) { return v == 0; });
    }
    sink(n, black ? nullptr : rows.data());
  }
}

MeasuringForm FilmsPart::form() const {
  MeasuringForm f;
  f.part = "films";
  f.add_fact("width_px", grid_.width_px);
  f.add_fact("height_px", grid_.height_px);
  f.add_fact("levels", levels_);
  f.columns = {"square", "level", "exposure_s", "thickness_um"};
  f.known = 3;
  f.note =
      "Fill in thickness_um: 0.12 mm are 120. Leave it empty where there is no film or none was "
      "measured; change nothing else.";
  for (std::size_t i = 0; i < squares_.size(); ++i) {
    f.rows.push_back({fmt::format("{}", i + 1), fmt::format("{}", squares_[i].level),
                      fmt::format("{:.10g}", exposure_s(squares_[i]))});
  }
  return f;
}

std::string FilmsPart::sheet(const std::string& form_file, const std::string& printer_file) const {
  detail::PartSheet s;
  s.title = "Films for calipers, " + printer_name_;
  s.about =
      "Squares of a few exposures and grey levels, cured as films on the floor of the vat. How thick "
      "they are tells how your resin cures and how bright each grey level is against the brightest "
      "one: all that a correction needs, without a power meter.";
  s.tools = {"Calipers or a micrometer that tell 0.01 mm",
             "Plastic tweezers or a plastic spatula: metal scratches the floor of the vat",
             "Paper towels that leave no lint; gloves, and glasses against the printer's light"};
  s.steps = {
      kNoPlatform,
      kPour,
      markup(
          "Print the file: <b>{} images</b>, each lit for <b>{:g} s</b>. A square is lit in the "
          "first of them, as often as its exposure says. Use the file's times for all layers: no "
          "bottom layers of another time, no light below full. Keep lifts short, or 0, if you can.",
          kImages, ask_.image_s),
      kPeel,
      kBlot,
      kMeasure,
      kTwice};
  std::vector<detail::SheetBox> boxes;
  for (std::size_t i = 0; i < squares_.size(); ++i) {
    const FilmSquare& q = squares_[i];
    boxes.push_back({q.box, static_cast<double>(q.level) / (levels_ - 1) * q.images / kImages,
                     fmt::format("{}", i + 1)});
  }
  s.picture = detail::plate_picture(grid_, boxes);
  s.caption = fmt::format(
      "The plate from above, with the numbers of the squares; they are {:.1f} mm wide. Darker ones "
      "get less light.",
      1e-3 * side_x_ * grid_.pixel_x_um);
  s.heads = {"square", "level", "exposure, s", "thickness, um"};
  for (const auto& row : form().rows) s.rows.push_back(row);
  s.after = markup(
      "Copy the last column into <b>{}</b> as <code>thickness_um</code>, in um: 0.12 mm are 120. "
      "Change nothing else there. The command makes a printer file and a resin file, which go "
      "together.{}",
      form_file,
      greys_ == 0 ? " This file format shows no grey, so the table tells the resin alone." : "");
  s.commands = detail::commands_on("films", form_file, printer_file, printer_name_);
  return detail::sheet_page(s);
}

}  // namespace slicecorr
