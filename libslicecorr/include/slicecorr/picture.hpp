// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file picture.hpp
/// Pictures in colour, and the files that they become.
///
/// Plain values; all functions are thread-safe. They throw nothing of their own.
#pragma once

#include <cstdint>
#include <vector>

namespace slicecorr {

/// 8-bit RGB picture, row by row.
struct ColourImage {
  int width_px = 0, height_px = 0;  ///< >= 0
  std::vector<std::uint8_t> rgb;    ///< 3 * width_px * height_px values: red, green, blue
};

/// Two pictures of the same height on white, with a gap between them.
ColourImage side_by_side(const ColourImage& left, const ColourImage& right);

/// Pictures of one size on white, `columns` to a row.
ColourImage tiled(const std::vector<ColourImage>& pictures, int columns);

/// The picture as a PNG file.
std::vector<std::uint8_t> encode_png(const ColourImage& image);

}  // namespace slicecorr
