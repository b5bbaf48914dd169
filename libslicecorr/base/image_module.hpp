// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What OpenImageIO does for us, behind a module that is loaded when it is first needed: with it
/// come more than 250 shared libraries, which would take every program a quarter of a second to
/// load, and most archives have no image that needs it.
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <vector>

namespace slicecorr::detail {

/// One channel of an image, row by row.
struct GreyImageValues {
  int width_px = 0, height_px = 0;
  std::vector<float> values;
};

struct ImageFunctions {
  /// Rows [y0, y1) of 8-bit pixels, `channels` 1..4 to each.
  using RowSink = std::function<void(int y0, int y1, const std::uint8_t* pixels, int channels)>;
  /// Decodes a sound PNG of any kind, which must have this size, in bands of `rows`. Gives what is
  /// wrong with it, empty: nothing. What the sink throws passes through.
  std::string (*decode_png)(std::span<const std::uint8_t> png, int width_px, int height_px,
                            int rows, const RowSink& sink);
  /// Reads the first image and channel of a TIFF file, of `most_px` pixels at most along a side, in its own
  /// numbers. Gives what is wrong with it, empty: nothing.
  std::string (*read_tiff)(const std::string& path, int most_px, GreyImageValues& out);
};

/// Loads the module at the first call. Thread-safe. Throws `DeviceError` when it is not there.
const ImageFunctions& image_functions();

/// Name of the function by which the module gives its functions.
inline constexpr const char* kImageModuleEntry = "slicecorr_image_functions";

}  // namespace slicecorr::detail
