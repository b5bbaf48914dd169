// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "bands/surface_collector.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace slicecorr::detail {

SurfaceCollector::SurfaceCollector(const PixelBox& box) {
  const int side = std::max({1, box.width(), box.height()});
  const int step = (side + SurfaceMaps::kMostCells - 1) / SurfaceMaps::kMostCells;
  maps_.box = box;
  maps_.pixels_per_cell = step;
  maps_.width = (box.width() + step - 1) / step;
  maps_.height = (box.height() + step - 1) / step;
  const auto cells = static_cast<std::size_t>(maps_.width) * static_cast<std::size_t>(maps_.height);
  below_.resize(cells);
  above_.resize(cells);
}

void SurfaceCollector::add(const EdgeSides& sides, const BandPredictor::PixelOfColumn& place) {
  const std::lock_guard lock(mutex_);
  const auto take = [](std::vector<Sum>& sums, std::size_t cell, float um) {
    if (std::isnan(um)) return;
    sums[cell].scaled += std::llround(std::ldexp(um, 20));
    ++sums[cell].columns;
  };
  for (std::size_t i = 0; i < sides.below_um.size(); ++i) {
    if (std::isnan(sides.below_um[i]) && std::isnan(sides.above_um[i])) continue;
    const Pixel p = place(i);
    const int x = (p.x - maps_.box.x0) / maps_.pixels_per_cell;
    const int y = (p.y - maps_.box.y0) / maps_.pixels_per_cell;
    if (x < 0 || x >= maps_.width || y < 0 || y >= maps_.height) continue;
    const auto cell = static_cast<std::size_t>(y) * static_cast<std::size_t>(maps_.width) +
                      static_cast<std::size_t>(x);
    take(below_, cell, sides.below_um[i]);
    take(above_, cell, sides.above_um[i]);
  }
}

std::vector<float> SurfaceCollector::means(const std::vector<Sum>& sums) const {
  std::vector<float> um;
  um.reserve(sums.size());
  for (const Sum& s : sums) {
    um.push_back(s.columns == 0
                     ? std::numeric_limits<float>::quiet_NaN()
                     : static_cast<float>(std::ldexp(static_cast<double>(s.scaled), -20) /
                                          static_cast<double>(s.columns)));
  }
  return um;
}

SurfaceMaps SurfaceCollector::maps() const {
  SurfaceMaps maps = maps_;
  maps.below_um = means(below_);
  maps.above_um = means(above_);
  return maps;
}

}  // namespace slicecorr::detail
