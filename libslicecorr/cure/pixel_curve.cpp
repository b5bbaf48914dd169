// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/cure.hpp"

namespace slicecorr {

int level_of_pixel(int value, int levels) { return (value * (levels - 1) + 127) / 255; }
int pixel_of_level(int level, int levels) {
  return levels > 1 ? (level * 255 + (levels - 1) / 2) / (levels - 1) : 0;
}

PixelCurve pixel_curve(const CureModel& model) {
  PixelCurve curve{};
  const int levels = static_cast<int>(model.level_phi.size());
  for (int v = 0; v < 256; ++v) {
    curve[static_cast<std::size_t>(v)] =
        model.level_phi[static_cast<std::size_t>(level_of_pixel(v, levels))];
  }
  return curve;
}

}  // namespace slicecorr
