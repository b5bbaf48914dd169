// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/tomo/shown_light.hpp"

#include <cmath>

#include "slicecorr/tomo/metrics.hpp"

namespace slicecorr::tomo {

Light asked_light(const Bench& bench, Light wanted) {
  const TomoGrid& grid = bench.grid;
  const FramePlaces& places = bench.places;
  if (!places.moved() && !places.uneven()) return wanted;
  Light asked(grid);
  for (int m = 0; m < grid.angles; ++m) {
    for (int c = 0; c < grid.pixels; ++c) {
      for (int z = 0; z < grid.light_rows(); ++z) {
        const double share = places.share(m, c, z);
        if (!(share > 0)) continue;
        if (!places.moved()) {
          const std::size_t i = grid.pixel(m, c, z);
          asked.values[i] = static_cast<float>(wanted.values[i] / share);
          continue;
        }
        const double pixel = places.pixel_of(m, c, z);
        const int first = static_cast<int>(std::floor(pixel));
        const double second = pixel - first;
        double light = 0;
        for (const int k : {0, 1}) {
          const int i = first + k;
          if (i < 0 || i >= grid.pixels) continue;
          light += (k ? second : 1 - second) * wanted.values[grid.pixel(m, i, z)];
        }
        asked.values[grid.pixel(m, c, z)] = static_cast<float>(light / share);
      }
    }
  }
  return asked;
}

Light shown_light(const Bench& bench, const std::vector<std::uint16_t>& levels) {
  Light light = light_of_levels(bench.grid, levels, bench.mw_cm2);
  if (!bench.places.uneven()) return light;
  const TomoGrid& grid = bench.grid;
  for (int m = 0; m < grid.angles; ++m) {
    for (int c = 0; c < grid.pixels; ++c) {
      for (int z = 0; z < grid.light_rows(); ++z) {
        light.values[grid.pixel(m, c, z)] *= static_cast<float>(bench.places.share(m, c, z));
      }
    }
  }
  return light;
}

}  // namespace slicecorr::tomo
