// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Loops over one frame of a block, [pixel][lane].
#pragma once

namespace slicecorr::tomo::detail {

/// to = weight of the pixel * from; they may be the same.
void weigh_frame(const float* from, const float* weight, int pixels, int lanes, float* to);
/// to[i] = weight[i] from[i] + weight[P-1-i] other[P-1-i].
void fold_frames(const float* from, const float* other, const float* weight, int pixels, int lanes,
                 float* to);
/// other[i] = weight[i] frame[P-1-i], then frame[i] becomes weight[i] frame[i].
void unfold_frame(float* frame, const float* weight, int pixels, int lanes, float* other);

}  // namespace slicecorr::tomo::detail
