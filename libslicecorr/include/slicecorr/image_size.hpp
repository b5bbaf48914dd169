// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file image_size.hpp
/// How large an image may be: slices of stacks, displays, flat-fields. Constants and a pure
/// function.
#pragma once

#include <cstdint>

namespace slicecorr {

/// Most columns, and most rows, of an image.
inline constexpr int kMostPixelsAcross = 65536;
/// Most pixels of an image in all.
inline constexpr std::int64_t kMostPixels = 1'000'000'000;

/// Whether an image of this size can be read: sides of 1 to `kMostPixelsAcross` pixels, at most
/// `kMostPixels` in all.
constexpr bool is_image_size(std::int64_t width_px, std::int64_t height_px) {
  return width_px >= 1 && height_px >= 1 && width_px <= kMostPixelsAcross &&
         height_px <= kMostPixelsAcross && width_px * height_px <= kMostPixels;
}

}  // namespace slicecorr
