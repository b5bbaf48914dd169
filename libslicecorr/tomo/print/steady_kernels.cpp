// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "tomo/print/steady_kernels.hpp"

#include <algorithm>
#include <cmath>

#include "base/kernels.hpp"

namespace slicecorr::tomo::detail {

SLICECORR_CLONES
void steady_shares(const SteadyDirection* directions, int count, const SteadyVoxel& voxel, int taps,
                   int* first, double* shares) {
  double edge[kSteadyAtOnce], half_c[kSteadyAtOnce], by_c[kSteadyAtOnce], before[kSteadyAtOnce];
  for (int k = 0; k < count; ++k) {
    const SteadyDirection& d = directions[k];
    const double u = voxel.y * d.cosine - voxel.x * d.sine,
                 place = (voxel.x * d.cosine + voxel.y * d.sine - voxel.first_mm) / voxel.pixel_mm;
    const double wide = std::abs(u) * d.turn_px, c = wide > kLeastBox ? wide : kLeastBox;
    half_c[k] = c / 2;
    by_c[k] = 1 / c;
    // To a whole number, from -65536 on.
    first[k] = static_cast<int>(place - d.boxes.outer - c / 2 + 65536.5) - 65536;
    edge[k] = static_cast<double>(first[k]) + 0.5 - place;
    before[k] = 0;
  }
  if (voxel.lit < 1) {
    const double gap = (1 - voxel.lit) / 2, by_lit = 1 / voxel.lit;
    for (int tap = 0; tap < taps; ++tap) {
      double* const to = shares + static_cast<std::ptrdiff_t>(tap) * kSteadyAtOnce;
      for (int k = 0; k < count; ++k) {
        const double end = edge[k] + static_cast<double>(tap);
        to[k] = (directions[k].boxes.below(end - gap, half_c[k], by_c[k]) -
                 directions[k].boxes.below(end - 1 + gap, half_c[k], by_c[k])) *
                by_lit;
      }
    }
    return;
  }
  for (int tap = 0; tap < taps; ++tap) {
    double* const to = shares + static_cast<std::ptrdiff_t>(tap) * kSteadyAtOnce;
    for (int k = 0; k < count; ++k) {
      const double up_to =
          directions[k].boxes.below(edge[k] + static_cast<double>(tap), half_c[k], by_c[k]);
      to[k] = up_to - before[k];
      before[k] = up_to;
    }
  }
}

SLICECORR_CLONES
double footprint_light(const FootprintOfLight& footprint, const float* light, std::size_t pitch) {
  float sum[8] = {};
  for (int i = 0; i < footprint.column_count; ++i, light += pitch) {
    const float of_column = footprint.columns[i];
    for (int r0 = 0; r0 < footprint.row_count; r0 += 8) {
      for (int r = 0; r < 8; ++r) sum[r] += of_column * footprint.rows[r0 + r] * light[r0 + r];
    }
  }
  return double{((sum[0] + sum[4]) + (sum[1] + sum[5])) + ((sum[2] + sum[6]) + (sum[3] + sum[7]))};
}

}  // namespace slicecorr::tomo::detail
