// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file grid_part.hpp
/// Crosses all over the plate, whose measured places tell where pixels really land (distortion.hpp): one layer on
/// the platform or on glass, or the light itself on paper.
///
/// Immutable and thread-safe.
#pragma once

#include <string>
#include <vector>

#include "slicecorr/measuring_form.hpp"
#include "slicecorr/process.hpp"
#include "slicecorr/target.hpp"

namespace slicecorr {

class GridPart final : public SliceSource {
 public:
  /// Images of the plate, `kImages` of them, each shown for `image_s`. Of the printer only its display is
  /// asked for. Throws `InputError` where a number is not above 0, or the plate has no room for the crosses.
  GridPart(const Printer& printer, double layer_um, double image_s);
  static constexpr int kImages = 4;

  struct Cross {
    double x_px = 0, y_px = 0;  ///< its middle, from the upper left corner of the image
    PixelBox across, down;      ///< its two strokes
  };
  /// Row by row from the upper left one.
  const std::vector<Cross>& crosses() const { return crosses_; }
  const Grid& grid() const override { return grid_; }
  PixelBox bounds() const override { return {0, 0, grid_.width_px, grid_.height_px}; }
  void read_band(const PixelBox& band, const Sink& sink) const override;
  std::vector<double> image_s() const {
    return std::vector(static_cast<std::size_t>(grid_.layers), image_s_);
  }
  /// The table to fill in, which `[display] distortion` names.
  MeasuringForm form() const;
  std::string sheet(const std::string& form_file, const std::string& printer_file) const;

 private:
  std::string printer_name_;
  Grid grid_;
  double image_s_;
  std::vector<Cross> crosses_;
};

}  // namespace slicecorr
