// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file level_images.hpp
/// Even images, one for each of some grey levels, all over the plate: a power meter on the display
/// then tells what light each level gives, which is the calibration of a printer. (Parts to measure:
/// tuning_part.hpp.)
///
/// Immutable and thread-safe.
#pragma once

#include <string>
#include <vector>

#include "slicecorr/file_greys.hpp"
#include "slicecorr/measuring_form.hpp"
#include "slicecorr/process.hpp"
#include "slicecorr/target.hpp"

namespace slicecorr {

class LevelImages final : public SliceSource {
 public:
  struct Ask {
    double layer_um = 50;  ///< > 0; nothing is printed, but archives say it
    double image_s = 30;   ///< for how long each image is shown, > 0
  };
  /// Images of the plate, from black to full light. Of the printer only its display is asked for
  /// (`light_is_measured` in unmeasured_light.hpp may be false). `greys`: what the archive holds; only
  /// levels are shown that come back as themselves. Throws `InputError` where a number is wrong.
  LevelImages(const Printer& printer, const FileGreys& greys, const Ask& ask);

  const Grid& grid() const override { return grid_; }
  PixelBox bounds() const override { return {0, 0, grid_.width_px, grid_.height_px}; }
  void read_band(const PixelBox& band, const Sink& sink) const override;
  /// Rising, 0 and the printer's greatest among them; one for each image.
  const std::vector<int>& levels() const { return levels_; }
  std::vector<double> image_s() const { return std::vector(levels_.size(), ask_.image_s); }
  /// The table to fill in, for `resinctl import`: levels and, empty, mW/cm².
  MeasuringForm form() const;
  /// A page to print: what to measure with which tool, and what to do with the table, whose file is
  /// called `form_file`; the printer's is called `printer_file`.
  std::string sheet(const std::string& form_file, const std::string& printer_file) const;

 private:
  Ask ask_;
  std::string printer_name_;
  double wavelength_nm_;
  Grid grid_;
  std::vector<int> levels_;
  std::vector<std::uint8_t> values_;  ///< the pixels of each image
};

}  // namespace slicecorr
