// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Light that goes sideways, as operators.
#pragma once

#include <cstddef>
#include <memory>
#include <utility>
#include <vector>

#include "slicecorr/process.hpp"
#include "slicecorr/tomo/light_blur.hpp"
#include "slicecorr/tomo/projector.hpp"

namespace slicecorr::tomo::detail {

/// How pixels, or groups of them, lie in the resin.
struct BlurPlaces {
  int wide = 1, high = 1;  ///< pixels of a group
  /// Groups a mm of the resin, near the axis: across and upwards.
  double columns_per_mm = 1, rows_per_mm = 1;
  double voxel_mm = 0;
  double most_way_mm = 0;  ///< in the resin
};

/// Whether light of these goes sideways at all.
bool light_goes_sideways(const Printer& printer, const Resin& resin);
/// The terms of light of these; one, sharp, where it goes straight on.
std::vector<BlurredLight> blurred_light(const Printer& printer, const Resin& resin,
                                        const BlurPlaces& places);
/// How far the printer's own spread reaches on the image, pixels across and up.
struct SpreadReach {
  int across = 0, up = 0;
};
SpreadReach reach_of_spread(const Printer& printer);

/// How a frame lies in memory: columns `pitch` numbers apart, of rows one after another.
struct FrameShape {
  int columns = 0, rows = 0;
  std::size_t pitch = 0;
};
/// to += the blurred frame.
void add_blurred(const ImageBlur& blur, const FrameShape& frame, const float* from, float* to);
/// The same by the transpose.
void add_blurred_back(const ImageBlur& blur, const FrameShape& frame, const float* from, float* to);

/// The sum of projectors of this grid, each with its blur before it.
using BlurredTerm = std::pair<ImageBlur, std::shared_ptr<const Projector>>;
std::unique_ptr<Projector> make_blurred_projector(const TomoGrid& grid,
                                                  std::vector<BlurredTerm> terms);

}  // namespace slicecorr::tomo::detail
