// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Sums of a prediction that goes tile by tile; see BandPredictor::add_tile.
#pragma once

#include <algorithm>
#include <cstdint>
#include <limits>

#include "base/tile_kernels.hpp"
#include "slicecorr/predict.hpp"

namespace slicecorr::detail {

struct TileSums {
  TileSums() {
    std::fill_n(inside_low, kLanes, std::numeric_limits<double>::infinity());
    std::fill_n(inside_high, kLanes, -std::numeric_limits<double>::infinity());
    std::fill_n(outside_high, kLanes, -std::numeric_limits<double>::infinity());
  }
  void add_to(Prediction& p) const {
    p.target_voxels += run_voxels;
    p.printed_voxels += run_printed + gap_printed;
    p.cure_through_voxels += gap_printed;
    p.undercure_voxels += run_voxels - run_printed;
    for (std::size_t i = 0; i < kLanes; ++i) {
      p.min_dose_inside = std::min(p.min_dose_inside, inside_low[i]);
      p.max_dose_inside = std::max(p.max_dose_inside, inside_high[i]);
      p.max_dose_outside = std::max(p.max_dose_outside, outside_high[i]);
    }
  }
  alignas(64) double inside_low[kLanes];
  alignas(64) double inside_high[kLanes];
  alignas(64) double outside_high[kLanes];
  std::uint64_t run_voxels = 0, run_printed = 0, gap_printed = 0;
};

}  // namespace slicecorr::detail
