// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file films_part.hpp
/// Squares that cure as films on the floor of a vat, without a platform: their thickness, which
/// calipers tell, says how bright grey levels are against the brightest one and how the resin cures
/// (docs/calipers.md).
///
/// All images are shown alike, for the same time: a square that is lit in the first k of them has k
/// times the exposure. So files of every format hold several times, those too that know one time for
/// all layers.
///
/// Immutable and thread-safe.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "slicecorr/file_greys.hpp"
#include "slicecorr/measuring_form.hpp"
#include "slicecorr/process.hpp"
#include "slicecorr/target.hpp"

namespace slicecorr {

/// One square.
struct FilmSquare {
  int level = 0;   ///< grey level of the printer
  int images = 0;  ///< it is lit in so many images, the first ones
  PixelBox box;    ///< on the plate
};

class FilmsPart final : public SliceSource {
 public:
  struct Ask {
    double layer_um = 50;  ///< > 0; nothing is lifted, but archives say it
    double image_s = 2;    ///< for how long each image is shown, > 0
  };
  /// Images that are shown: squares are lit in 1, 2, 4, 8 or all of them.
  static constexpr int kImages = 16;

  /// Of the printer only its display is asked for (`light_is_measured` in unmeasured_light.hpp may be
  /// false). `greys`: what the archive holds; only levels are shown that come back as themselves, of
  /// black and white full light alone. Throws `InputError` where a number is wrong or the plate has no
  /// room for squares.
  FilmsPart(const Printer& printer, const FileGreys& greys, const Ask& ask);

  const Grid& grid() const override { return grid_; }
  PixelBox bounds() const override { return bounds_; }
  void read_band(const PixelBox& band, const Sink& sink) const override;
  std::vector<double> image_s() const { return std::vector(kImages, ask_.image_s); }
  /// Number n, which is cut out of it, is `squares()[n - 1]`.
  const std::vector<FilmSquare>& squares() const { return squares_; }
  double exposure_s(const FilmSquare& square) const { return square.images * ask_.image_s; }
  /// How many grey levels beside the brightest are shown.
  int greys() const { return greys_; }
  /// The table to fill in, for `resinctl calibrate`: squares, levels, times and, empty, thickness.
  MeasuringForm form() const;
  /// A page to print: where each square lies, and how to peel, blot and measure it. The table is called
  /// `form_file`, the printer's file `printer_file`.
  std::string sheet(const std::string& form_file, const std::string& printer_file) const;

 private:
  /// Where squares lie, in pixels.
  struct Layout {
    int side_x, side_y, apart_x, apart_y, columns, rows;
    int width() const { return columns * side_x + (columns + 1) * apart_x; }
    int height() const { return rows * side_y + (rows + 1) * apart_y; }
  };
  /// Nothing: the plate has no room for so many.
  std::optional<Layout> layout_of(int count) const;
  void place(const Layout& layout);
  void draw(std::size_t square, const PixelBox& band, std::vector<std::uint8_t>& rows) const;

  Ask ask_;
  std::string printer_name_;
  int levels_;
  Grid grid_;
  PixelBox bounds_;
  int greys_ = 0;
  std::vector<FilmSquare> squares_;
  /// The number of each square as dots, `side_x_` by `side_y_`: true is cut out.
  std::vector<std::vector<bool>> cut_;
  int side_x_ = 0, side_y_ = 0;
};

}  // namespace slicecorr
