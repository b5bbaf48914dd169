// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "tomo/operators/square_kernels.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>

#include "base/kernels.hpp"
#include "tomo/operators/footprint.hpp"

namespace slicecorr::tomo::detail {

SLICECORR_CLONES
void weigh_row(const SquareRow& row, int* first, float* weights) {
  // The base in double, what is added to it small.
  const double whole = std::floor(row.place);
  const auto part = static_cast<float>(row.place - whole);
  const int base = static_cast<int>(whole), n = row.count;
  // The turn moves voxels by as much as the middle of a stretch of them does.
  constexpr int kStretch = 16;
  // All voxels of the row look as many pixels far.
  const float reach = 0.5f * static_cast<float>(row.taps - 1);
  // C at the pixels' edges, one after another; the first is 0 and the last 1.
  float* const last = weights + static_cast<std::size_t>(row.taps - 1) * n;
  for (int k = 0; k < n; ++k) {
    const float at = part + static_cast<float>(k) * row.step;
    first[k] = base + static_cast<int>(std::floor(at - reach + 0.5f));
    last[k] = 0;
  }
  // Gaps between pixels leave the last edge open: its pixel is weighed as the others.
  const int edges = row.lit < 1 ? row.taps : row.taps - 1;
  for (int tap = 0; tap < edges; ++tap) {
    float* const to = weights + static_cast<std::size_t>(tap) * n;
    for (int k0 = 0; k0 < n; k0 += kStretch) {
      const int k1 = std::min(k0 + kStretch, n);
      const float turn = std::abs(row.u + 0.5f * static_cast<float>(k0 + k1 - 1) * row.u_step);
      const Boxes<float> boxes(row.one, row.other, turn);
      if (row.lit < 1) {
        const float half = row.lit / 2, by_lit = 1 / row.lit;
        for (int k = k0; k < k1; ++k) {
          const float at = part + static_cast<float>(k) * row.step;
          const float middle = std::floor(at - reach + 0.5f) + static_cast<float>(tap) - at;
          to[k] = (boxes.below(middle + half) - boxes.below(middle - half)) * by_lit;
        }
        continue;
      }
      for (int k = k0; k < k1; ++k) {
        const float at = part + static_cast<float>(k) * row.step;
        const float edge = std::floor(at - reach + 0.5f) + (static_cast<float>(tap) + 0.5f) - at;
        const float up_to = boxes.below(edge);
        to[k] = up_to - last[k];
        last[k] = up_to;
      }
    }
  }
  for (int k = 0; k < n && !(row.lit < 1); ++k) last[k] = 1 - last[k];
  if (row.dim == nullptr) return;
  for (int tap = 0; tap < row.taps; ++tap) {
    float* const to = weights + static_cast<std::size_t>(tap) * n;
    for (int k = 0; k < n; ++k) to[k] *= row.dim[k] * row.dim_row;
  }
}

namespace {

template <int L>
[[gnu::always_inline]] inline void gather_lanes(const SquareRow& row, const int* first,
                                                const float* weights, Masks lit, const float* light,
                                                float* field) {
  for (int k = 0; k < row.count; ++k) {
    const float* from = light + static_cast<std::ptrdiff_t>(first[k]) * L;
    float sum[L] = {};
    for (int tap = 0; tap < row.taps; ++tap, from += L) {
      const float w = weights[static_cast<std::size_t>(tap) * row.count + k];
      for (int l = 0; l < L; ++l) sum[l] += w * from[l];
    }
    float* const to = field + static_cast<std::size_t>(k) * L;
    if (lit == nullptr) {
      for (int l = 0; l < L; ++l) to[l] += sum[l];
    } else {
      for (int l = 0; l < L; ++l) to[l] += (lit[k] >> l & 1) != 0 ? sum[l] : 0.0f;
    }
  }
}

template <int L>
[[gnu::always_inline]] inline void scatter_lanes(const SquareRow& row, const int* first,
                                                 const float* weights, Masks lit,
                                                 const float* field, float* light) {
  for (int k = 0; k < row.count; ++k) {
    float* to = light + static_cast<std::ptrdiff_t>(first[k]) * L;
    const float* const from = field + static_cast<std::size_t>(k) * L;
    float value[L];
    for (int l = 0; l < L; ++l) value[l] = from[l];
    if (lit != nullptr) {
      for (int l = 0; l < L; ++l) value[l] = (lit[k] >> l & 1) != 0 ? value[l] : 0.0f;
    }
    for (int tap = 0; tap < row.taps; ++tap, to += L) {
      const float w = weights[static_cast<std::size_t>(tap) * row.count + k];
      for (int l = 0; l < L; ++l) to[l] += w * value[l];
    }
  }
}

}  // namespace

SLICECORR_CLONES
void gather_row(const SquareRow& row, int lanes, const int* first, const float* weights, Masks lit,
                const float* light, float* field) {
  switch (lanes) {
    case 1:
      for (int tap = 0; tap < row.taps; ++tap) {
        const float* const w = weights + static_cast<std::size_t>(tap) * row.count;
        for (int k = 0; k < row.count; ++k) {
          const float value = w[k] * light[first[k] + tap];
          field[k] += lit == nullptr || (lit[k] & 1) != 0 ? value : 0.0f;
        }
      }
      return;
    case 16:
      return gather_lanes<16>(row, first, weights, lit, light, field);
    default:
      return gather_lanes<32>(row, first, weights, lit, light, field);
  }
}

SLICECORR_CLONES
void scatter_row(const SquareRow& row, int lanes, const int* first, const float* weights, Masks lit,
                 const float* field, float* light) {
  switch (lanes) {
    case 1:
      for (int k = 0; k < row.count; ++k) {
        const float value = lit == nullptr || (lit[k] & 1) != 0 ? field[k] : 0.0f;
        for (int tap = 0; tap < row.taps; ++tap) {
          light[first[k] + tap] += weights[static_cast<std::size_t>(tap) * row.count + k] * value;
        }
      }
      return;
    case 16:
      return scatter_lanes<16>(row, first, weights, lit, field, light);
    default:
      return scatter_lanes<32>(row, first, weights, lit, field, light);
  }
}

}  // namespace slicecorr::tomo::detail
