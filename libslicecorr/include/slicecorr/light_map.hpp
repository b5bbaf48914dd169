// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file light_map.hpp
/// How bright each place of a display is: what a flat-field means for the pixels of a stack.
///
/// Columns of pixels are independent of each other, so a flat-field is a set of classes of columns,
/// one per value of 0 to 255 that occurs. Everything is exact in integers, so that it is the same
/// on all machines.
///
/// Immutable and thread-safe once made (and coarsened); `light_groups` is thread-safe. Only the
/// constructor throws.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "slicecorr/grid.hpp"
#include "slicecorr/orientation.hpp"
#include "slicecorr/process.hpp"

namespace slicecorr {

/// Value of the light at each pixel of a stack's images.
class LightMap {
 public:
  /// Of `images` that lie like `frame` when `printer` shows them. Throws `InputError` when its
  /// flat-field is one of the plate, and printer and images contradict each other about how that
  /// lies; or when images and display differ in size.
  LightMap(const Printer& printer, const Grid& images, const ImageFrame& frame);
  /// A display whose light is even.
  LightMap() = default;

  /// Every pixel gets the light of the calibration: there is no flat-field, or one that is flat.
  bool even() const { return even_; }
  /// Share of the calibration's light that a value stands for; above 1 where the value is greater
  /// than the reference.
  double factor(std::uint8_t value) const { return 1.0 * value / reference_; }
  /// The value that stands for the calibration itself, 1..255; where light is even, of all pixels.
  std::uint8_t reference() const { return static_cast<std::uint8_t>(reference_); }
  /// The greatest value of the flat-field.
  std::uint8_t greatest() const { return greatest_; }

  /// Joins every `step` neighbouring values into the one in their middle: fewer models, and factors
  /// that are off by up to step / 2 / reference. No light stays no light.
  void coarsen(int step) { step_ = step; }

  /// Value of the pixel in column x of row y, which must lie in the image.
  std::uint8_t value(int x, int y) const;
  /// Values of the pixels in `box`, row by row: width() * height() bytes.
  void values(const PixelBox& box, std::uint8_t* out) const;
  /// How many pixels of a box have each value.
  std::array<std::uint64_t, 256> counts(const PixelBox& box) const;

 private:
  /// Between which two samples of the flat-field a pixel lies, and how near to the second.
  struct Between {
    std::int32_t first = 0, second = 0;
    std::int64_t share = 0;  ///< 0 to twice the pixels of the axis
  };
  static std::vector<Between> between(int pixels, int samples);
  std::uint8_t sample(int x, int y) const;

  FlatField field_;
  bool even_ = true, fine_ = false;
  int reference_ = 255, step_ = 1;
  std::uint8_t greatest_ = 255;
  int width_px_ = 0, height_px_ = 0;  ///< of the images
  Turn turn_;                         ///< from the images to the flat-field's frame
  std::vector<Between> across_, down_;
  std::int64_t whole_ = 1;
};

/// The same of the printer's UV lamp ([uv] flat_field). Throws as `LightMap`.
LightMap uv_light_map(Printer printer, const Grid& images, const ImageFrame& frame);

/// Columns of a band by value of light.
struct LightGroup {
  std::uint8_t value = 0;
  std::vector<std::uint32_t> columns;  ///< of the band, rising
};
/// All columns of `box`, those of one value together, values rising; `keep`: only columns where it
/// is not 0; null: all.
std::vector<LightGroup> light_groups(const LightMap& map, const PixelBox& box,
                                     const std::uint8_t* keep);

}  // namespace slicecorr
