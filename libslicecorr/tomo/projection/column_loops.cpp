// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "tomo/projection/column_loops.hpp"

#include <algorithm>

#include "base/kernels.hpp"
#include "parallel/silent.hpp"

namespace slicecorr::tomo::detail {
namespace {

using slicecorr::detail::silent;

constexpr int kW = 16;
constexpr std::size_t kRowsAChunk = 2048;
/// From one row of kW numbers to the next.
constexpr std::ptrdiff_t kStep = kW;
/// Rows whose products are summed in single precision.
constexpr std::size_t kRowsASum = 64;

}  // namespace

void ColumnLoops::each(std::size_t count, const std::function<void(const Stretch&)>& body) const {
  const auto width = static_cast<std::size_t>(width_);
  const std::size_t rows = padded(count) / width;
  const std::size_t chunks = (rows + kRowsAChunk - 1) / kRowsAChunk;
  parallel_for(silent(context_, chunks, 4), "", chunks, [&](std::size_t c) {
    const std::size_t first = c * kRowsAChunk, last = std::min(rows, first + kRowsAChunk);
    for (int column = 0; column < width_; column += kW) {
      body({first * width + static_cast<std::size_t>(column), last - first, width, column});
    }
  });
}

std::vector<Doubles> ColumnLoops::sum(
    std::size_t count, int kinds, const std::function<void(const Stretch&, double*)>& body) const {
  const auto width = static_cast<std::size_t>(width_);
  const std::size_t rows = padded(count) / width;
  const std::size_t chunks = (rows + kRowsAChunk - 1) / kRowsAChunk;
  const std::size_t numbers = static_cast<std::size_t>(kinds) * kW, halves = width / kW;
  std::vector<double> parts(chunks * halves * numbers, 0.0);
  each(count, [&](const Stretch& s) {
    const std::size_t chunk = s.at / width / kRowsAChunk;
    body(s, parts.data() + (chunk * halves + static_cast<std::size_t>(s.first) / kW) * numbers);
  });
  std::vector<Doubles> sums(static_cast<std::size_t>(kinds));
  for (std::size_t kind = 0; kind < sums.size(); ++kind) {
    sums[kind] = {};
    for (std::size_t c = 0; c < chunks; ++c) {
      for (std::size_t column = 0; column < width; ++column) {
        sums[kind][column] += parts[(c * halves + column / kW) * numbers + kind * kW + column % kW];
      }
    }
    if (lanes_ == 1) {
      double all = 0;
      for (std::size_t column = 0; column < width; ++column) all += sums[kind][column];
      sums[kind].fill(all);
    }
  }
  return sums;
}

SLICECORR_CLONES
void step_dose(const Stretch& s, const Asked& asked, const float* change, const float* t,
               float* dose, float* excess, double* sums, float* extremes) {
  float low[kW], high[kW], most[kW];
  for (int k = 0; k < kW; ++k) {
    low[k] = extremes[k];
    high[k] = extremes[kW + k];
    most[k] = extremes[2 * kW + k];
  }
  for (std::size_t r0 = 0; r0 < s.rows; r0 += kRowsASum) {
    float loss[kW] = {};
    for (std::size_t r = r0; r < std::min(s.rows, r0 + kRowsASum); ++r) {
      const std::size_t at = s.at + r * s.stride;
      for (int k = 0; k < kW; ++k) {
        const float d = dose[at + k] + t[k] * change[at + k];
        const float least = asked.least[at + k], limit = asked.most[at + k];
        const float above = d - limit, below = least - d;
        const float e = (above > 0 ? above : 0) - (below > 0 ? below : 0);
        dose[at + k] = d;
        excess[at + k] = e;
        loss[k] += e * e;
        const bool gel = least > 0, judged = gel || limit < 1e30f;
        low[k] = gel && d < low[k] ? d : low[k];
        high[k] = judged && !gel && d > high[k] ? d : high[k];
        most[k] = judged && d > most[k] ? d : most[k];
      }
    }
    for (int k = 0; k < kW; ++k) sums[k] += loss[k];
  }
  for (int k = 0; k < kW; ++k) {
    extremes[k] = low[k];
    extremes[kW + k] = high[k];
    extremes[2 * kW + k] = most[k];
  }
}

SLICECORR_CLONES
void count_void(const Stretch& s, const Asked& asked, const float* dose, const float* at_least,
                double* sums) {
  float count[kW] = {};
  for (std::size_t r = 0; r < s.rows; ++r) {
    const std::size_t at = s.at + r * s.stride;
    for (int k = 0; k < kW; ++k) {
      const bool empty = !(asked.least[at + k] > 0) && asked.most[at + k] < 1e30f;
      count[k] += empty && dose[at + k] >= at_least[k] ? 1.0f : 0.0f;
    }
  }
  for (int k = 0; k < kW; ++k) sums[k] += count[k];
}

SLICECORR_CLONES
void extremes_in_bands(const Stretch& s, const float* per_least, const float* per_most,
                       const float* dose, float* extremes) {
  for (std::size_t r = 0; r < s.rows; ++r) {
    const std::size_t at = s.at + r * s.stride;
    for (int k = 0; k < kW; ++k) {
      const float of_least = dose[at + k] * per_least[at + k];
      const float of_most = dose[at + k] * per_most[at + k];
      float &low = extremes[k], &high = extremes[kW + k];
      low = per_least[at + k] > 0 && of_least < low ? of_least : low;
      high = of_most > high ? of_most : high;
    }
  }
}

SLICECORR_CLONES
void count_above(const Stretch& s, const float* per_most, const float* dose, const float* at_least,
                 double* sums) {
  float count[kW] = {};
  for (std::size_t r = 0; r < s.rows; ++r) {
    const std::size_t at = s.at + r * s.stride;
    for (int k = 0; k < kW; ++k) {
      const bool judged = per_most[at + k] > 0;
      count[k] += judged && dose[at + k] * per_most[at + k] >= at_least[k] ? 1.0f : 0.0f;
    }
  }
  for (int k = 0; k < kW; ++k) sums[k] += count[k];
}

SLICECORR_CLONES
void slope(const Stretch& s, const Asked& asked, const float* dose, const float* change,
           const float* t, double* sums) {
  for (std::size_t r0 = 0; r0 < s.rows; r0 += kRowsASum) {
    float sum[kW] = {};
    for (std::size_t r = r0; r < std::min(s.rows, r0 + kRowsASum); ++r) {
      const std::size_t at = s.at + r * s.stride;
      for (int k = 0; k < kW; ++k) {
        const float d = dose[at + k] + t[k] * change[at + k];
        const float above = d - asked.most[at + k], below = asked.least[at + k] - d;
        sum[k] += ((above > 0 ? above : 0) - (below > 0 ? below : 0)) * change[at + k];
      }
    }
    for (int k = 0; k < kW; ++k) sums[k] += sum[k];
  }
}

SLICECORR_CLONES
void curvature(const Stretch& s, const float* excess, const float* change, double* sums) {
  for (std::size_t r0 = 0; r0 < s.rows; r0 += kRowsASum) {
    float sum[kW] = {};
    for (std::size_t r = r0; r < std::min(s.rows, r0 + kRowsASum); ++r) {
      const std::size_t at = s.at + r * s.stride;
      for (int k = 0; k < kW; ++k) {
        sum[k] += excess[at + k] != 0 ? change[at + k] * change[at + k] : 0.0f;
      }
    }
    for (int k = 0; k < kW; ++k) sums[k] += sum[k];
  }
}

SLICECORR_CLONES
void change_of_gradient(const Stretch& s, const float* gradient, const float* before, float* y) {
  for (std::size_t r = 0; r < s.rows; ++r) {
    const std::size_t at = s.at + r * s.stride;
    for (int k = 0; k < kW; ++k) y[at + k] = gradient[at + k] - before[at + k];
  }
}

SLICECORR_CLONES
void free_gradient(const Stretch& s, const Quadratic& of, float* q) {
  const float* live = of.live + s.first;
  for (std::size_t r = 0; r < s.rows; ++r) {
    const std::size_t at = s.at + r * s.stride;
    for (int k = 0; k < kW; ++k) {
      const float g = of.gradient[at + k], b = of.light[at + k];
      const bool held = (b <= 0 && g > 0) || (b >= of.cap && g < 0);
      q[at + k] = held ? 0.0f : live[k] * g;
    }
  }
}

SLICECORR_CLONES
void products(const Stretch& s, const Quadratic& of, double* sums) {
  const int pairs = static_cast<int>(of.steps.size()), kinds = of.sums();
  const float* live = of.live + s.first;
  static thread_local std::vector<float> buffer;
  buffer.resize(static_cast<std::size_t>(kinds + 2 * pairs) * kW);
  float* sum = buffer.data();
  float* free_y = sum + static_cast<std::ptrdiff_t>(kinds) * kW;
  for (std::size_t r0 = 0; r0 < s.rows; r0 += kRowsASum) {
    std::fill_n(sum, static_cast<std::size_t>(kinds) * kW, 0.0f);
    for (std::size_t r = r0; r < std::min(s.rows, r0 + kRowsASum); ++r) {
      const std::size_t at = s.at + r * s.stride;
      float free[kW], q[kW];
      for (int k = 0; k < kW; ++k) {
        const float g = of.gradient[at + k], b = of.light[at + k];
        const bool held = (b <= 0 && g > 0) || (b >= of.cap && g < 0);
        free[k] = held ? 0.0f : live[k];
        q[k] = free[k] * g;
        sum[k] += q[k] * q[k];
      }
      for (int j = 0; j < pairs; ++j) {
        const float* y = of.changes[j] + at;
        float* to = free_y + j * kStep;
        float* yq = sum + of.yq(j) * kStep;
        for (int k = 0; k < kW; ++k) {
          to[k] = free[k] * y[k];
          yq[k] += q[k] * y[k];
        }
      }
      for (int i = 0; i < pairs; ++i) {
        const float* step = of.steps[i] + at;
        float* sq = sum + of.sq(i) * kStep;
        float si[kW], yi[kW];
        for (int k = 0; k < kW; ++k) {
          si[k] = step[k];
          yi[k] = free_y[i * kW + k];
          sq[k] += q[k] * si[k];
        }
        for (int j = i; j < pairs; ++j) {
          float* sy = sum + of.sy(i, j) * kStep;
          const float* yj = free_y + j * kStep;
          for (int k = 0; k < kW; ++k) sy[k] += si[k] * yj[k];
        }
        for (int j = 0; j <= i; ++j) {
          float* yy = sum + of.yy(i, j) * kStep;
          const float* yj = free_y + j * kStep;
          for (int k = 0; k < kW; ++k) yy[k] += yi[k] * yj[k];
        }
      }
    }
    for (int i = 0; i < kinds * kW; ++i) sums[i] += sum[i];
  }
}

SLICECORR_CLONES
void descend(const Stretch& s, const Quadratic& of, const float* factors, float* direction) {
  const int pairs = static_cast<int>(of.steps.size());
  const float* live = of.live + s.first;
  for (std::size_t r = 0; r < s.rows; ++r) {
    const std::size_t at = s.at + r * s.stride;
    float d[kW];
    for (int k = 0; k < kW; ++k) d[k] = factors[k] * of.gradient[at + k];
    for (int i = 0; i < pairs; ++i) {
      const float* step = of.steps[i] + at;
      const float* y = of.changes[i] + at;
      const float* cs = factors + (1 + i) * kStep;
      const float* cy = factors + (1 + pairs + i) * kStep;
      for (int k = 0; k < kW; ++k) d[k] += cs[k] * step[k] + cy[k] * y[k];
    }
    for (int k = 0; k < kW; ++k) {
      const float g = of.gradient[at + k], b = of.light[at + k];
      const bool held = (b <= 0 && g > 0) || (b >= of.cap && g < 0);
      const float to = b - (held ? 0.0f : live[k] * d[k]);
      const float low = to > 0 ? to : 0;
      direction[at + k] = (low < of.cap ? low : of.cap) - b;
    }
  }
}

SLICECORR_CLONES
void step_light(const Stretch& s, const float* direction, const float* t, float cap, float* light,
                float* step) {
  for (std::size_t r = 0; r < s.rows; ++r) {
    const std::size_t at = s.at + r * s.stride;
    for (int k = 0; k < kW; ++k) {
      const float by = t[k] * direction[at + k];
      step[at + k] = by;
      const float to = light[at + k] + by;
      const float low = to > 0 ? to : 0;
      light[at + k] = low < cap ? low : cap;
    }
  }
}

}  // namespace slicecorr::tomo::detail
