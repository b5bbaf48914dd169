// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file test_part.hpp
/// A part to print and measure, from which `resinctl fit-spread` finds how far light spreads.
///
/// In every slice it shows the same: lines of 1 to 12 pixels, free and far apart, gaps as wide in a
/// solid block, both upright and level, each with its width in pixels beside it, and a solid square
/// whose sides are knife edges for a camera.
///
/// Immutable and thread-safe.
#pragma once

#include <string>
#include <vector>

#include "slicecorr/measuring_form.hpp"
#include "slicecorr/process.hpp"
#include "slicecorr/target.hpp"

namespace slicecorr {

/// A line or gap of it.
struct TestFeature {
  bool gap = false, upright = false;
  int width_px = 0;
  double width_um = 0;
  PixelBox box{};  ///< of its light, or of what stays dark
};

class SpreadTestPart final : public SliceSource {
 public:
  /// Images of the plate, as `slice` makes them; `height_um` is rounded to whole layers, at least
  /// one. Throws `InputError` where the display is too small.
  SpreadTestPart(const Printer& printer, double layer_um, double height_um);

  const Grid& grid() const override { return grid_; }
  PixelBox bounds() const override { return bounds_; }
  void read_band(const PixelBox& band, const Sink& sink) const override;
  /// Upright lines from left to right, level ones from the top down, then the gaps like this.
  const std::vector<TestFeature>& features() const { return features_; }
  /// One side of the square.
  const PixelBox& square() const { return square_; }
  /// A table for `resinctl fit-spread`, to fill in.
  MeasuringForm form() const;
  /// A page to print: what to measure where with which tool. `form_file`: what that table is called,
  /// `printer_file`: what the printer's file is.
  std::string sheet(const std::string& form_file, const std::string& printer_file) const;

 private:
  std::string printer_name_;
  Grid grid_;
  PixelBox bounds_, square_;
  std::vector<PixelBox> blocks_;  ///< that the gaps are cut into
  std::vector<TestFeature> features_;
  std::vector<std::uint8_t> pixels_;  ///< of any slice
};

}  // namespace slicecorr
