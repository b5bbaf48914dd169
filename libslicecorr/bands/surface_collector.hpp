// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Collects maps of a print's surface from the bands of a prediction.
#pragma once

#include <cstdint>
#include <mutex>
#include <vector>

#include "slicecorr/predict.hpp"
#include "slicecorr/surface_maps.hpp"

namespace slicecorr::detail {

/// Thread-safe; the order of bands does not matter.
class SurfaceCollector {
 public:
  /// `box`: pixels that may have edges.
  explicit SurfaceCollector(const PixelBox& box);
  void add(const EdgeSides& sides, const BandPredictor::PixelOfColumn& place);
  SurfaceMaps maps() const;

 private:
  /// Sums in units of 2^-20 um, so that their order does not matter.
  struct Sum {
    std::int64_t scaled = 0;
    std::int64_t columns = 0;
  };
  std::vector<float> means(const std::vector<Sum>& sums) const;

  SurfaceMaps maps_;
  std::vector<Sum> below_, above_;
  std::mutex mutex_;
};

}  // namespace slicecorr::detail
