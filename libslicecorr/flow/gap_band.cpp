// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "gap_band.hpp"

#include <algorithm>

#include "base/kernels.hpp"

namespace slicecorr::detail {

void solve_bands(const GapLevels& levels, const BandView* bands, double* const* y) {
  const std::size_t n = levels.size();
  double last[kBeside] = {}, before[kBeside] = {};
  for (std::size_t j = 0; j < n; ++j) {
    for (std::size_t l = 0; l < kBeside; ++l) {
      const double v = (y[l][j] - bands[l].below2[j] * before[l]) - bands[l].below[j] * last[l];
      before[l] = last[l];
      last[l] = y[l][j] = v;
    }
  }
  double next[kBeside];
  for (std::size_t l = 0; l < kBeside; ++l) next[l] = y[l][n - 1] *= bands[l].inverse[n - 1];
  for (std::size_t j = n - 1; j-- > 0;) {
    for (std::size_t l = 0; l < kBeside; ++l) {
      const double above = bands[l].spread * levels.per_step[j] * bands[l].inverse[j];
      next[l] = y[l][j] = y[l][j] * bands[l].inverse[j] + above * next[l];
    }
  }
}

void solve_bands_transposed(const GapLevels& levels, const BandView* bands, double* const* y) {
  const std::size_t n = levels.size();
  double last[kBeside];
  for (std::size_t l = 0; l < kBeside; ++l) last[l] = y[l][0] *= bands[l].inverse[0];
  for (std::size_t j = 1; j < n; ++j) {
    for (std::size_t l = 0; l < kBeside; ++l) {
      const double above = bands[l].spread * levels.per_step[j - 1] * bands[l].inverse[j];
      last[l] = y[l][j] = y[l][j] * bands[l].inverse[j] + above * last[l];
    }
  }
  double next[kBeside], after[kBeside];
  for (std::size_t l = 0; l < kBeside; ++l) {
    after[l] = y[l][n - 1];
    next[l] = y[l][n - 2] -= bands[l].below[n - 1] * after[l];
  }
  for (std::size_t j = n - 2; j-- > 0;) {
    for (std::size_t l = 0; l < kBeside; ++l) {
      const double v =
          (y[l][j] - bands[l].below2[j + 2] * after[l]) - bands[l].below[j + 1] * next[l];
      after[l] = next[l];
      next[l] = y[l][j] = v;
    }
  }
}

SLICECORR_CLONES
void mix_profiles(const GapLevels& levels, const double* y, const int* from, const double* weight,
                  std::size_t count, double* into) {
  const std::size_t n = levels.size();
  std::fill_n(into, n, 0.0);
  for (std::size_t k = 0; k < count; ++k) {
    const double* profile = y + static_cast<std::size_t>(from[k]) * n;
    for (std::size_t j = 0; j < n; ++j) into[j] += weight[k] * profile[j];
  }
  const double* share = levels.share.data();
  for (std::size_t j = 0; j < n; ++j) into[j] *= share[j];
}

double level_sum(std::size_t n, const double* a, const double* y) {
  // Four sums, as wide as every processor can add at once, so that all of them get the same bits.
  double sum[4] = {};
  std::size_t j = 0;
  for (; j + 4 <= n; j += 4) {
    for (std::size_t l = 0; l < 4; ++l) sum[l] += a[j + l] * y[j + l];
  }
  for (; j < n; ++j) sum[0] += a[j] * y[j];
  return (sum[0] + sum[1]) + (sum[2] + sum[3]);
}

SLICECORR_CLONES
void share_profile(std::size_t n, const double* y, const int* from, const double* weight,
                   std::size_t count, double* into) {
  for (std::size_t k = 0; k < count; ++k) {
    double* to = into + static_cast<std::size_t>(from[k]) * n;
    for (std::size_t j = 0; j < n; ++j) to[j] += weight[k] * y[j];
  }
}

}  // namespace slicecorr::detail
