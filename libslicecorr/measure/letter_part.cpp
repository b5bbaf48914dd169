// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/letter_part.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "measure/part_sheet.hpp"
#include "measure/sheet_commands.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/image_size.hpp"

namespace slicecorr {

using namespace page;

namespace {

constexpr int kWide = static_cast<int>(kLetterF[0].size()),
              kHigh = static_cast<int>(kLetterF.size());

/// The eight ways side by side, with their numbers.
Markup letters_picture() {
  constexpr int kDot = 10, kStep = 100, kRow = 130, kInRow = 4;
  Markup svg = markup(
      R"(<svg viewBox="0 0 {0} {1}" width="{0}" height="{1}" role="img" aria-label="eight ways in which an F is seen, numbered">)",
      kStep * kInRow, 2 * kRow);
  for (std::size_t i = 0; i < kLetterTurns.size(); ++i) {
    const std::vector<std::string> rows = letter_seen(kLetterTurns[i]);
    const int x = kStep * static_cast<int>(i % kInRow), y = kRow * static_cast<int>(i / kInRow);
    svg += markup(R"(<rect class="plate" x="{}" y="{}" width="90" height="90"/>)", x + 5, y + 5);
    for (std::size_t row = 0; row < rows.size(); ++row) {
      for (std::size_t column = 0; column < rows[row].size(); ++column) {
        if (rows[row][column] != '#') continue;
        svg += markup(
            R"x(<rect x="{}" y="{}" width="{}" height="{}" fill="rgb(86,144,230)"/>)x",
            x + 50 + kDot * static_cast<int>(column) - kDot * static_cast<int>(rows[0].size()) / 2,
            y + 50 + kDot * static_cast<int>(row) - kDot * static_cast<int>(rows.size()) / 2, kDot,
            kDot);
      }
    }
    svg += markup(R"(<text text-anchor="middle" x="{}" y="{}" font-size="15">{}</text>)", x + 50,
                  y + 114, i + 1);
  }
  return svg + markup("</svg>");
}

}  // namespace

std::vector<std::string> letter_seen(const Turn& turn) {
  const bool across = turn.swap_axes;
  std::vector<std::string> rows(static_cast<std::size_t>(across ? kWide : kHigh),
                                std::string(static_cast<std::size_t>(across ? kHigh : kWide), ' '));
  for (int y = 0; y < kHigh; ++y) {
    for (int x = 0; x < kWide; ++x) {
      const Pixel to = turned(Pixel{x, y}, turn, kWide, kHigh);
      rows[static_cast<std::size_t>(to.y)][static_cast<std::size_t>(to.x)] =
          kLetterF[static_cast<std::size_t>(y)][static_cast<std::size_t>(x)];
    }
  }
  return rows;
}

Orientation orientation_of_letter(int number, const Orientation& shown) {
  if (number < 1 || number > static_cast<int>(kLetterTurns.size())) {
    throw InputError(fmt::format("picture {} of the F; expected a number from 1 to {}", number,
                                 kLetterTurns.size()));
  }
  // The F is turned to the display by `shown`, and then by the display itself. What undoes the latter
  // after the way in which the plate is seen where all is right is what the printer's file must say.
  const Turn seen = kLetterTurns[static_cast<std::size_t>(number - 1)];
  const Turn right = kLetterTurns[kRightLetter - 1];
  const Turn needed = right.then(seen.inverse()).then(turn_from_plate(shown));
  return turned(Orientation{}, needed);
}

std::vector<std::string> orientation_lines(const Orientation& o) {
  const char* const mirror = o.mirror_x && o.mirror_y ? "xy"
                             : o.mirror_x             ? "x"
                             : o.mirror_y             ? "y"
                                                      : "none";
  std::vector<std::string> lines{fmt::format("mirror = \"{}\"", mirror)};
  if (o.portrait) lines.emplace_back("orientation = \"portrait\"");
  return lines;
}

GreyImage letter_image(int width_px, int height_px) {
  GreyImage image{width_px, height_px, {}};
  image.pixels.assign(static_cast<std::size_t>(width_px) * static_cast<std::size_t>(height_px), 0);
  // A dot of darkness around it, where the image has room for that.
  const int dot = std::max(1, std::min(width_px / (kWide + 2), height_px / (kHigh + 2)));
  const int left = (width_px - kWide * dot) / 2, top = (height_px - kHigh * dot) / 2;
  for (int y = std::max(0, top); y < std::min(height_px, top + kHigh * dot); ++y) {
    for (int x = std::max(0, left); x < std::min(width_px, left + kWide * dot); ++x) {
      const auto row = static_cast<std::size_t>((y - top) / dot),
                 column = static_cast<std::size_t>((x - left) / dot);
      if (kLetterF[row][column] == '#') {
        image.pixels[static_cast<std::size_t>(y) * static_cast<std::size_t>(width_px) +
                     static_cast<std::size_t>(x)] = 255;
      }
    }
  }
  return image;
}

LetterPart::LetterPart(const Printer& printer, double layer_um, double image_s, int images)
    : printer_name_(printer.name),
      shown_(printer.orientation.value_or(Orientation{})),
      grid_(plate_grid(printer)),
      image_s_(image_s) {
  if (!(layer_um > 0)) throw InputError("layers are 0 um high; expected more");
  if (!(image_s > 0)) throw InputError("images are shown for 0 s; expected more");
  if (images < 1) throw InputError("no images are shown; expected one or more");
  grid_.layer_um = layer_um;
  grid_.layers = images;
  if (!is_image_size(grid_.width_px, grid_.height_px)) {
    throw InputError(fmt::format("printer '{}' has {} x {} pixels; expected at most {} in all",
                                 printer.name, grid_.width_px, grid_.height_px, kMostPixels));
  }
  image_ = letter_image(grid_.width_px, grid_.height_px);
}

void LetterPart::read_band(const PixelBox& band, const Sink& sink) const {
  std::vector<std::uint8_t> rows;
  for (int y = band.y0; y < band.y1; ++y) {
    const auto row = image_.pixels.begin() + static_cast<std::ptrdiff_t>(y) * grid_.width_px;
    rows.insert(rows.end(), row + band.x0, row + band.x1);
  }
  const bool black = std::all_of(rows.begin(), rows.end(), [](auto v) { return v == 0; });
  for (int n = 0; n < grid_.layers; ++n) sink(n, black ? nullptr : rows.data());
}

std::string LetterPart::sheet(const std::string& printer_file) const {
  detail::PartSheet s;
  s.title = "How the screen stands, " + printer_name_;
  s.about =
      "An F on the screen tells how the printer turns and mirrors what it shows. Where its file does "
      "not say that, parts come out as mirror images of themselves.";
  s.tools = {"Thin white paper, to lay on the screen",
             "Glasses against the printer's light: do not look into it"};
  s.steps = {
      "Take off vat and platform, so that nothing lies on the screen and nothing comes down on it.",
      "Lay the paper on the screen. The light comes through it.",
      markup("Print the file: the F is shown {} times, each time for <b>{:g} s</b>. The printer's "
             "motor may do what it will.",
             grid_.layers, image_s_),
      "Stand in front of the printer and look down at the paper. How does the F stand? The lower edge "
      "of each picture is the front of the printer."};
  s.picture = letters_picture();
  s.caption = fmt::format(
      "Eight ways in which the F can stand. Picture {} is right for a printer that is lit from below.",
      kRightLetter);
  s.heads = {"picture", "[display] of the printer file must say", "yours"};
  for (int number = 1; number <= static_cast<int>(kLetterTurns.size()); ++number) {
    std::string lines;
    for (const std::string& line : orientation_lines(orientation_of_letter(number, shown_))) {
      lines += (lines.empty() ? "" : ", ") + line;
    }
    if (number == kRightLetter) lines += " (as it is)";
    s.rows.push_back({fmt::format("{}", number), lines});
  }
  s.after = markup(
      "Write these lines into <b>{}</b>, in place of those that it has (without orientation it is "
      "landscape), and look again: the F must stand as in picture {}. Show the file of the same format "
      "that you print with.",
      printer_file, kRightLetter);
  s.commands = detail::commands_on("f", "", printer_file, printer_name_);
  return sheet_page(s);
}

}  // namespace slicecorr
