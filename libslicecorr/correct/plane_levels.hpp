// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Levels of an image of which light is wanted that lies between them, where light spreads: what a
/// pixel has too much is handed on to the pixels beside it.
///
/// For projectors with few levels. Pixels are decided row by row, every second row from its end.
/// In features a pixel gets the least level with the light that is wanted of it, less what was handed
/// to it, and hands on what it has more to those pixels around it that are not decided and belong to
/// the same feature, as its light spreads over them. Nothing is handed on that is missing: after
/// each choice every feature pixel decided so far has the light that it needs, as far as full light
/// gives it. Gaps get at most the light that is wanted of them.
///
/// A pure function; thread-safe.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "cure/light_spread.hpp"
#include "slicecorr/cure.hpp"

namespace slicecorr::detail {

/// An image, row by row; all arrays have width * height values.
struct PlaneOfLight {
  int width_px = 0, height_px = 0;
  const double* wanted = nullptr;  ///< before it spreads, in the numbers of the level table
  const double* needed = nullptr;  ///< after it has spread, of pixels of features; at least that
  const std::uint8_t* feature = nullptr;  ///< not 0 in features
};

struct PlaneOfLevels {
  std::vector<std::uint8_t> levels;  ///< indices of the table
  std::size_t short_pixels = 0;      ///< of features, with less than they need
  double most_short = 0;             ///< greatest light that is missing, >= 0
  bool handed_on = false;            ///< whether light spreads far enough for that
};

/// Whether light spreads with a sigma of half a pixel or more along both axes.
bool is_wide(const LightBlur& blur);

/// Light is handed on where the spread has a sigma of half a pixel or more along both axes: below
/// that pixels stay what they are. Pixels of one feature touch, at their corners or along a side.
PlaneOfLevels levels_of_plane(const LevelTable& levels, const PlaneOfLight& plane,
                              const LightBlur& blur);

}  // namespace slicecorr::detail
