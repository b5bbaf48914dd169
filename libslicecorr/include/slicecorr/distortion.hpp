// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file distortion.hpp
/// Where pixels really land: lenses and mirrors bend the even grid that an image is (barrel, pincushion,
/// keystone, unequal pitches).
///
/// Measured places of a target (`slicecorr testpart grid`) are met by polynomials, least squares: x and y
/// on the plate are sums of u^i v^j, i and j from 0 to 3, u = 2 x_px / width - 1 and v = 2 y_px / height - 1
/// of images of the plate. Barrel of the third order (r + k r³) is met exactly, keystone but for the cube of its slant.
/// As the plate has no marks of its own, shift and turn of the measured places as a whole are taken out;
/// their scale stays. Image places count from the upper left corner, mm from the corner of the plate at the
/// least x and y.
///
/// Plain values; all functions are pure and thread-safe.
#pragma once

#include <array>
#include <cstddef>
#include <optional>
#include <string>
#include <vector>

namespace slicecorr {

struct FlatField;
struct Printer;

/// One mark of a target.
struct DistortionPoint {
  double x_px = 0, y_px = 0;  ///< its middle in images of the plate
  double x_mm = 0, y_mm = 0;  ///< measured on the plate, y upwards; any corner counts as 0
};

/// The map. `u` and `v` are -1..1 over the image.
struct Distortion {
  static constexpr std::size_t kPowers = 4, kTerms = kPowers * kPowers;
  std::array<double, kTerms> x_mm{}, y_mm{};  ///< factors of u^i v^j at 4 i + j
  int points = 0;                             ///< that it was fitted to
  double rms_um = 0;                          ///< by which it misses them
  /// Of the way by which points miss an even grid: the greatest, and root of the mean square.
  double most_off_um = 0, rms_off_um = 0;
  /// Where a place of the image lands, mm.
  std::array<double, 2> place_mm(double u, double v) const;
  /// d(x, y)/d(u, v) row by row.
  std::array<double, 4> slopes_mm(double u, double v) const;
  bool operator==(const Distortion&) const = default;
};

/// Fewest marks: sixteen numbers of each way, and some more that tell whether they hold.
inline constexpr std::size_t kFewestMarks = 20;

/// The map that meets the points best. Throws `InputError` for too few of them, for such that leave more
/// than a fifth of the display's width or height out, that are mirrored or far from where the display's
/// pixels say, for one that is far off the others, and for a map that folds.
Distortion fit_distortion(const std::vector<DistortionPoint>& points, const Printer& printer);

/// The place of the image that lands there, px; nothing where none does that is within a twentieth of the
/// display.
std::optional<std::array<double, 2>> image_place(const Distortion& map, const Printer& printer,
                                                 double x_mm, double y_mm);
/// Longest straight line on the plate, mm, that stays straight to a fiftieth of a pixel in images.
double straight_mm(const Distortion& map, const Printer& printer);

/// Sides of pixels over the display.
struct PitchRange {
  double least_x_um = 0, greatest_x_um = 0, least_y_um = 0, greatest_y_um = 0;
};
PitchRange pitch_range(const Distortion& map, const Printer& printer);
/// Light by place, as pixels of other sizes have it that all send the same: as one over their area, 1 in the
/// middle of the display. Nothing where it differs by less than a step of such a picture, a 255th.
std::optional<FlatField> light_by_pitch(const Distortion& map, const Printer& printer);
/// In words; empty without a distortion.
std::string distortion_in_words(const Printer& printer);

}  // namespace slicecorr
