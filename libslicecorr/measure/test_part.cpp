// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/test_part.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "measure/part_sheet.hpp"
#include "measure/sheet_commands.hpp"
#include "picture/sheet.hpp"
#include "slicecorr/error.hpp"

namespace slicecorr {

namespace {

constexpr int kWidest = 12;
constexpr int kSum = kWidest * (kWidest + 1) / 2;
/// Pixels between features: less would let the light of one reach the next.
constexpr int kLeastApart = 16, kMostApart = 60;

/// Where things are, in pixels, for features so far apart.
struct Layout {
  int apart = 0;
  int letters() const { return std::max(1, apart / 20); }
  int length() const { return 3 * apart; }                     ///< of lines and gaps
  int across() const { return kSum + (kWidest + 1) * apart; }  ///< all of a kind, with both ends
  int named() const { return 9 * letters() + apart / 2; }      ///< for numbers beside them
  int thick() const { return length() + 2 * apart; }           ///< of the block with gaps
  /// Upright ones above each other and the square, level ones to the right of them.
  int width() const { return across() + apart + length() + 2 * named() + 2 * apart + thick(); }
  int height() const {
    const int left = length() + named() + apart + thick() + named() + 2 * apart + length();
    return std::max(left, across());
  }
};

std::string name_of(const TestFeature& f) {
  return fmt::format("{} {} {} px", f.upright ? "upright" : "level", f.gap ? "gap" : "line",
                     f.width_px);
}

}  // namespace

SpreadTestPart::SpreadTestPart(const Printer& printer, double layer_um, double height_um) {
  printer_name_ = printer.name;
  grid_ = plate_grid(printer);
  grid_.layer_um = layer_um;
  grid_.layers = std::max(1, static_cast<int>(std::lround(height_um / layer_um)));
  constexpr int margin = 8;
  const auto fits = [&](const Layout& l) {
    return l.width() + 2 * margin <= grid_.width_px && l.height() + 2 * margin <= grid_.height_px;
  };
  Layout l{kMostApart};
  while (l.apart > kLeastApart && !fits(l)) --l.apart;
  if (!fits(l)) {
    throw InputError(fmt::format(
        "printer '{}' shows {} x {} pixels of the plate; expected at least {} x {}, which the test "
        "part takes up",
        printer.name, grid_.width_px, grid_.height_px, l.width() + 2 * margin,
        l.height() + 2 * margin));
  }
  detail::Sheet sheet(grid_.width_px, grid_.height_px);
  const int left = (grid_.width_px - l.width()) / 2, top = (grid_.height_px - l.height()) / 2;
  // Of a kind: where the first one is, and where their numbers are.
  const auto draw = [&](bool gap, bool upright, int column, int row, int name_at) {
    int at = (upright ? column : row) + l.apart;
    for (int n = 1; n <= kWidest; ++n) {
      const PixelBox box = upright ? PixelBox{at, row, at + n, row + l.length()}
                                   : PixelBox{column, at, column + l.length(), at + n};
      if (gap) {
        sheet.clear(box.x0, box.y0, box.width(), box.height());
      } else {
        sheet.fill(box.x0, box.y0, box.width(), box.height());
      }
      const std::string name = fmt::format("{}", n);
      const int half = detail::Sheet::width_of(name, l.letters()) / 2;
      if (upright) {
        sheet.words(at + n / 2 - half, name_at, name, l.letters());
      } else {
        sheet.words(name_at, at + n / 2 - 4 * l.letters(), name, l.letters());
      }
      features_.push_back(
          {gap, upright, n, n * (upright ? grid_.pixel_x_um : grid_.pixel_y_um), box});
      at += n + l.apart;
    }
  };
  const int block_row = top + l.length() + l.named() + l.apart;
  const int level_column = left + l.across() + l.apart;
  const int block_column = level_column + l.length() + l.named() + l.apart;
  blocks_ = {{left, block_row, left + l.across(), block_row + l.thick()},
             {block_column, top, block_column + l.thick(), top + l.across()}};
  for (const PixelBox& b : blocks_) sheet.fill(b.x0, b.y0, b.width(), b.height());
  const int gap = l.apart / 2;
  draw(false, true, left, top, top + l.length() + gap);
  draw(false, false, level_column, top, level_column + l.length() + gap);
  draw(true, true, left, block_row + l.apart, block_row + l.thick() + gap);
  draw(true, false, block_column + l.apart, top, block_column + l.thick() + gap);
  const int square_row = block_row + l.thick() + l.named() + 2 * l.apart;
  square_ = {left + l.apart, square_row, left + l.apart + l.length(), square_row + l.length()};
  sheet.fill(square_.x0, square_.y0, square_.width(), square_.height());
  for (int y = 0; y < grid_.height_px; ++y) {
    for (int x = 0; x < grid_.width_px; ++x) {
      const bool lit = sheet.light()[pixels_.size()] > 0;
      pixels_.push_back(lit ? 255 : 0);
      if (lit) bounds_ = bounds_.united({x, y, x + 1, y + 1});
    }
  }
}

void SpreadTestPart::read_band(const PixelBox& band, const Sink& sink) const {
  std::vector<std::uint8_t> rows;
  for (int y = band.y0; y < band.y1; ++y) {
    const auto row = pixels_.begin() + static_cast<std::ptrdiff_t>(y) * grid_.width_px;
    rows.insert(rows.end(), row + band.x0, row + band.x1);
  }
  const bool black = std::all_of(rows.begin(), rows.end(), [](auto v) { return v == 0; });
  for (int n = 0; n < grid_.layers; ++n) sink(n, black ? nullptr : rows.data());
}

MeasuringForm SpreadTestPart::form() const {
  MeasuringForm f;
  f.part = "spread";
  f.add_fact("layer_um", grid_.layer_um);
  f.add_fact("width_px", grid_.width_px);
  f.add_fact("height_px", grid_.height_px);
  f.columns = {"name", "kind", "designed_um", "printed_um", "depth_um"};
  f.known = 3;
  f.note =
      "Fill in printed_um, in um: 0 where nothing is left, empty where it was not measured; and "
      "depth_um, how far above the window, where that differs.";
  for (const TestFeature& feature : features_) {
    f.rows.push_back(
        {name_of(feature), feature.gap ? "gap" : "line", fmt::format("{:g}", feature.width_um)});
  }
  return f;
}

std::string SpreadTestPart::sheet(const std::string& form_file,
                                  const std::string& printer_file) const {
  detail::PartSheet s;
  s.title = "Lines and gaps, " + printer_name_;
  s.about =
      "Lines of 1 to 12 pixels and gaps as wide. How much wider lines print, and how much narrower "
      "gaps, tells how far light spreads.";
  s.tools = {"A microscope with a scale, 0.002 mm or finer"};
  s.steps = {
      page::markup("Print it as you print parts: layer by layer the stack as it is, continuously "
                   "after a correction without that of spread: <code>{}</code>.",
                   detail::kCorrectWithoutSpread),
      "Wash it as you wash parts, don't cure it further.",
      "Look at the side that was at the window. Measure the width of each line and gap in the middle "
      "of its length; its number says how many pixels wide it is in the image.",
      "Write 0 where a line is not there or a gap has closed."};
  std::vector<detail::SheetBox> boxes;
  for (const TestFeature& f : features_) {
    // Gaps are named beside the block that they are cut into.
    if (f.gap) continue;
    boxes.push_back({f.box, 1, ""});
  }
  for (const PixelBox& block : blocks_) boxes.push_back({block, 0.8, ""});
  for (const TestFeature& f : features_) {
    if (f.gap) boxes.push_back({f.box, 0, ""});
  }
  boxes.push_back({square_, 1, "square"});
  s.picture = detail::plate_picture(grid_, boxes);
  s.caption =
      "One slice: free lines, upright and level, and gaps in blocks; narrow ones may be too fine for "
      "this drawing. The square's sides are edges for a camera.";
  s.heads = {"what", "designed, um", "measured, um"};
  for (const TestFeature& f : features_) {
    s.rows.push_back({name_of(f), fmt::format("{:g}", f.width_um)});
  }
  s.after = page::markup(
      "Copy the last column into <b>{}</b> as <code>printed_um</code>, in um; leave empty what you "
      "did not measure.",
      form_file);
  s.commands = detail::commands_on("spread", form_file, printer_file, printer_name_);
  return detail::sheet_page(s);
}

}  // namespace slicecorr
