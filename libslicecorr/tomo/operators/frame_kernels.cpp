// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "tomo/operators/frame_kernels.hpp"

#include <cstddef>

#include "base/kernels.hpp"

namespace slicecorr::tomo::detail {

SLICECORR_CLONES
void weigh_frame(const float* from, const float* weight, int pixels, int lanes, float* to) {
  if (lanes == 1) {
    for (int i = 0; i < pixels; ++i) to[i] = weight[i] * from[i];
    return;
  }
  for (int i = 0; i < pixels; ++i) {
    const std::ptrdiff_t at = static_cast<std::ptrdiff_t>(i) * lanes;
    for (int l = 0; l < lanes; ++l) to[at + l] = weight[i] * from[at + l];
  }
}

SLICECORR_CLONES
void fold_frames(const float* from, const float* other, const float* weight, int pixels, int lanes,
                 float* to) {
  for (int i = 0; i < pixels; ++i) {
    const std::ptrdiff_t at = static_cast<std::ptrdiff_t>(i) * lanes;
    const std::ptrdiff_t back = static_cast<std::ptrdiff_t>(pixels - 1 - i) * lanes;
    const float w = weight[i], w_back = weight[pixels - 1 - i];
    for (int l = 0; l < lanes; ++l) to[at + l] = w * from[at + l] + w_back * other[back + l];
  }
}

SLICECORR_CLONES
void unfold_frame(float* frame, const float* weight, int pixels, int lanes, float* other) {
  for (int i = 0; i < pixels; ++i) {
    const std::ptrdiff_t at = static_cast<std::ptrdiff_t>(i) * lanes;
    const std::ptrdiff_t back = static_cast<std::ptrdiff_t>(pixels - 1 - i) * lanes;
    for (int l = 0; l < lanes; ++l) other[at + l] = weight[i] * frame[back + l];
  }
  weigh_frame(frame, weight, pixels, lanes, frame);
}

}  // namespace slicecorr::tomo::detail
