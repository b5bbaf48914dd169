// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "correct/coupled_kernels.hpp"

#include <algorithm>

#include "base/kernels.hpp"

namespace slicecorr::detail {

namespace {

template <class Real>
[[gnu::always_inline]] inline void add_rows(Real* field, std::size_t stride, const Real* taps,
                                            int rows, int width, Real change) {
  for (int y = 0; y < rows; ++y, field += stride, taps += width) {
    for (int x = 0; x < width; x += kTapLanes) {
      for (int i = 0; i < kTapLanes; ++i) field[x + i] += taps[x + i] * change;
    }
  }
}

template <class Real>
[[gnu::always_inline]] inline void step_rows(Real* dose, const Real* light, const Real* below,
                                             std::size_t stride, Real gain, Real kept) {
  for (int y = 0; y < kSquare; ++y, dose += stride, light += stride, below += stride) {
    Real next[kSquare];
    for (int i = 0; i < kSquare; ++i) next[i] = gain * light[i] + kept * below[i];
    for (int i = 0; i < kSquare; ++i) dose[i] = next[i];
  }
}

}  // namespace

SLICECORR_CLONES
void add_taps(float* field, std::size_t stride, const float* taps, int rows, int width,
              float change) {
  add_rows(field, stride, taps, rows, width, change);
}
SLICECORR_CLONES
void add_taps(double* field, std::size_t stride, const double* taps, int rows, int width,
              double change) {
  add_rows(field, stride, taps, rows, width, change);
}
SLICECORR_CLONES
void step_square(float* dose, const float* light, const float* below, std::size_t stride,
                 float gain, float kept) {
  step_rows(dose, light, below, stride, gain, kept);
}
SLICECORR_CLONES
void step_square(double* dose, const double* light, const double* below, std::size_t stride,
                 double gain, double kept) {
  step_rows(dose, light, below, stride, gain, kept);
}

SLICECORR_CLONES
bool passes_bounds(const float* light, const float* below, const float* dose, const float* guide,
                   const BoundRows& bounds, std::size_t stride, float gain, float kept, float slack,
                   bool with_soft) {
  int any = 0;
  for (int y = 0; y < kSquare; ++y) {
    const std::size_t at = static_cast<std::size_t>(y) * stride;
    for (std::size_t k = at; k < at + kSquare; ++k) {
      const float v = gain * light[k] + kept * below[k];
      const float least =
          (guide[k] >= bounds.holds ? bounds.least[k] : std::min(bounds.least[k], guide[k])) -
          slack;
      const float most = std::max(bounds.most[k] - bounds.share[k] * dose[k], guide[k]) + slack;
      any |= static_cast<int>(v < least) | static_cast<int>(v > most);
      if (with_soft) {
        const float high = std::min(guide[k] + bounds.over_guide[k], bounds.soft[k]) + slack;
        const float low = guide[k] - bounds.under_guide[k] - slack;
        any |= static_cast<int>(v > high) | static_cast<int>(v < low);
      }
    }
  }
  return any != 0;
}

SLICECORR_CLONES
bool stays_inside(const float* light, const float* dose, const float* guide, const float* own,
                  const BoundRows& bounds, std::size_t stride) {
  int any = 0;
  for (int y = 0; y < kSquare; ++y) {
    const std::size_t at = static_cast<std::size_t>(y) * stride;
    for (std::size_t k = at; k < at + kSquare; ++k) {
      const float low = std::min(light[k], dose[k]), high = std::max(light[k], dose[k]);
      const float guide_low = std::min(guide[k], own[k]);
      const float most = std::min(bounds.most[k], bounds.soft[k] * (1 + bounds.share[k]));
      any |= static_cast<int>(low < bounds.least[k]) |
             static_cast<int>(guide_low < bounds.least[k]) |
             static_cast<int>(high * (1 + bounds.share[k]) > most) |
             static_cast<int>(std::min(bounds.over_guide[k], bounds.under_guide[k]) < 1e6F);
    }
  }
  return any == 0;
}

SLICECORR_CLONES
void aim_square(const float* light, const float* below, const float* dose, const float* guide,
                const BoundRows& bounds, const SoftRows& soft, std::size_t stride,
                const AimRule& rule, const AimRows& aim, float* raw_lo, float* raw_hi) {
  const float per_gain = 1 / rule.gain;
  for (std::size_t y = 0; y < kSquare; ++y) {
    const std::size_t from = y * stride;
    for (std::size_t k = from; k < from + kSquare; ++k) {
      const float seen = rule.kept * below[k], now = rule.gain * light[k] + seen;
      float lo = guide[k] >= bounds.holds ? bounds.least[k] : std::min(bounds.least[k], guide[k]);
      float hi = std::max(bounds.most[k] - bounds.share[k] * dose[k], guide[k]);
      float low = guide[k] - bounds.under_guide[k], high = guide[k] + bounds.over_guide[k];
      float high_weight = soft.high_weight[k];
      high_weight = bounds.soft[k] < high ? rule.soft_weight : high_weight;
      high = std::min(high, bounds.soft[k]);
      low = rule.with_soft ? low : std::min(low, now);
      high = rule.with_soft ? high : std::max(high, now);
      aim.hi_weight[k] = high < hi ? high_weight : 1;
      hi = std::min(hi, high);
      aim.lo_weight[k] = low > lo ? soft.low_weight[k] : 1;
      lo = std::max(lo, std::min(low, hi));
      hi = std::max(hi, lo);
      const float lo_light = std::min((lo - seen) * per_gain, rule.bright);
      const float hi_light = (hi - seen) * per_gain;
      raw_lo[k] = lo_light;
      raw_hi[k] = hi_light;
      const float inwards = std::min(rule.room, std::max(0.0F, hi_light - lo_light) / 2);
      aim.lo[k] = lo_light + inwards;
      aim.hi[k] = hi_light - inwards;
    }
  }
}

SLICECORR_CLONES
bool any_missed(const float* light, const float* raw_lo, const float* raw_hi, std::size_t stride,
                float slack) {
  int any = 0;
  for (std::size_t y = 0; y < kSquare; ++y) {
    const std::size_t from = y * stride;
    for (std::size_t k = from; k < from + kSquare; ++k) {
      any |= static_cast<int>(light[k] < raw_lo[k] - slack) |
             static_cast<int>(light[k] > raw_hi[k] + slack);
    }
  }
  return any != 0;
}

SLICECORR_CLONES
Pull pull_of(const float* light, const AimRows& aim, std::size_t at, std::size_t stride,
             const float* taps, int rows, int width) {
  float slope[kTapLanes] = {}, curvature[kTapLanes] = {};
  for (int y = 0; y < rows; ++y, at += stride, taps += width) {
    for (int x = 0; x < width; x += kTapLanes) {
      for (int i = 0; i < kTapLanes; ++i) {
        const std::size_t k = at + static_cast<std::size_t>(x + i);
        const float v = light[k], tap = taps[x + i];
        const float under = aim.lo[k] - v, over = v - aim.hi[k];
        const float lo_weight = aim.lo_weight[k], hi_weight = aim.hi_weight[k];
        const float low = under > 0 ? lo_weight : 0, high = over > 0 ? hi_weight : 0;
        slope[i] += tap * (low * under - high * over);
        curvature[i] += tap * tap * (low + high);
      }
    }
  }
  Pull sum{0, 0};
  for (int i = 0; i < kTapLanes; ++i) {
    sum.slope += slope[i];
    sum.curvature += curvature[i];
  }
  return sum;
}

SLICECORR_CLONES
bool judge_square(const double* dose, const double* below, const double* kind, std::size_t stride,
                  const MiddleRule& rule, double near, SquareSums& sums) {
  const double per = 1 / rule.norm, share = rule.below_share;
  int any = 0;
  for (int y = 0; y < kSquare; ++y, dose += stride, below += stride, kind += stride) {
    for (int i = 0; i < kSquare; ++i) {
      const double middle = (dose[i] + share * below[i]) * per;
      any |= static_cast<int>(kind[i] > 0) &
             (static_cast<int>(middle < 1) | static_cast<int>(dose[i] < 1));
      any |= static_cast<int>(kind[i] < 0) & static_cast<int>(middle >= near);
    }
    if (!any) continue;
    for (int i = 0; i < kSquare; ++i) {
      const double middle = (dose[i] + share * below[i]) * per;
      if (kind[i] > 0) {
        const double lacks = std::max(0.0, 1 - dose[i]);
        sums.loss += lacks * lacks / 2;
        sums.under += middle < 1;
        sums.parted += kind[i] > 1 && dose[i] < 1 && middle >= 1;
      } else if (kind[i] < 0 && middle >= 1) {
        sums.loss += (middle - 1) * (middle - 1) / 2;
        ++sums.through;
      }
    }
  }
  return any != 0;
}

SLICECORR_CLONES
bool stays_right(const double* light, const double* dose, const double* kind, std::size_t stride,
                 double near) {
  int any = 0;
  for (int y = 0; y < kSquare; ++y, light += stride, dose += stride, kind += stride) {
    for (int i = 0; i < kSquare; ++i) {
      any |= static_cast<int>(kind[i] > 0) & static_cast<int>(std::min(light[i], dose[i]) < 1);
      any |= static_cast<int>(kind[i] < 0) & static_cast<int>(std::max(light[i], dose[i]) >= near);
    }
  }
  return any == 0;
}

}  // namespace slicecorr::detail
