// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file letter_part.hpp
/// A letter F on the display, which tells how the display turns and mirrors what it shows: an F looks
/// different in each of the eight ways. Whoever stands before a printer that is lit from below, and looks
/// down at its screen, sees the plate mirrored left to right where all is right, for the part hangs head
/// down, and its front is at the front.
///
/// Pure and thread-safe; a `LetterPart` is immutable.
#pragma once

#include <array>
#include <string>
#include <string_view>
#include <vector>

#include "slicecorr/process.hpp"
#include "slicecorr/stack.hpp"
#include "slicecorr/target.hpp"

namespace slicecorr {

/// The ways in which an upright F can be seen, in the order of their numbers, from 1 on: upright, mirrored
/// left to right, upside down, mirrored top to bottom, and the four on their side.
inline constexpr std::array<Turn, 8> kLetterTurns = {{{false, false, false},
                                                      {false, true, false},
                                                      {false, true, true},
                                                      {false, false, true},
                                                      {true, true, false},
                                                      {true, false, false},
                                                      {true, false, true},
                                                      {true, true, true}}};
/// The one of a printer whose orientation is right: `kLetterTurns[kRightLetter - 1]`.
inline constexpr int kRightLetter = 2;

/// The strokes of an upright F: rows from the top, '#' where it is lit.
inline constexpr std::array<std::string_view, 7> kLetterF = {"#####", "#    ", "#    ", "#### ",
                                                             "#    ", "#    ", "#    "};
/// The same as it is seen in a way.
std::vector<std::string> letter_seen(const Turn& turn);

/// The orientation of a printer on whose screen an F is seen like picture `number`, 1 to 8. `shown`: the
/// orientation with which it was shown; none: the F is upright in the images themselves. Throws
/// `InputError` for other numbers.
Orientation orientation_of_letter(int number, const Orientation& shown = {});
/// The lines of [display] that say it: `mirror = "x"` and, of a portrait one, `orientation`.
std::vector<std::string> orientation_lines(const Orientation& orientation);

/// An F that fills most of an image of this size, upright.
GreyImage letter_image(int width_px, int height_px);

/// The F on the plate, shown as images for some seconds each.
class LetterPart final : public SliceSource {
 public:
  /// Images of the plate, `images` of them, each shown for `image_s`. Of the printer only its display is
  /// asked for. Throws `InputError` where a number is not above 0.
  LetterPart(const Printer& printer, double layer_um, double image_s, int images = 4);

  const Grid& grid() const override { return grid_; }
  PixelBox bounds() const override { return {0, 0, grid_.width_px, grid_.height_px}; }
  void read_band(const PixelBox& band, const Sink& sink) const override;
  std::vector<double> image_s() const {
    return std::vector(static_cast<std::size_t>(grid_.layers), image_s_);
  }
  /// A page to print: what to look at, the eight pictures, and what to write into the printer's file,
  /// which is called `printer_file`.
  std::string sheet(const std::string& printer_file) const;

 private:
  std::string printer_name_;
  Orientation shown_;
  Grid grid_;
  double image_s_;
  GreyImage image_;
};

}  // namespace slicecorr
