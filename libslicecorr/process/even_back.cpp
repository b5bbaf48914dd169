// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "process/even_back.hpp"

#include <algorithm>
#include <cmath>

#include "slicecorr/layer_heights.hpp"
#include "slicecorr/process.hpp"
#include "slicecorr/units.hpp"

namespace slicecorr::detail {

EvenBack::EvenBack(const Printer& printer, const Resin& resin, const Process& process,
                   double layer_um) {
  if (!process.even_light || !(printer.platform_reflectance > 0)) return;
  const LayerHeights heights(process.layer_heights_um);
  const double hb_um = resin.absorbance_height10_um / units::kLn10;
  // Even light is kept in steps of 1/255: less is nothing.
  constexpr double least = 1e-4;
  for (int n = 0;; ++n) {
    const double front_um =
        std::max(0.0, heights.place_um(n + 0.5, layer_um) - process.even_light->gap_um);
    const double back = printer.platform_reflectance * std::exp(-2 * front_um / hb_um);
    if (back < least) break;
    times_.push_back(1 + back);
  }
}

}  // namespace slicecorr::detail
