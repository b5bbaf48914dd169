// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file preview.hpp
/// Small pictures of a part for archives.
#pragma once

#include "slicecorr/stack.hpp"

namespace slicecorr::detail {

/// The mean of whole boxes of pixels, so that no side is longer than `most_px`.
GreyImage shrink(const GreyImage& image, int most_px);

/// Shrunk to fit, in the middle of a black picture of exactly this size.
GreyImage framed(const GreyImage& image, int width_px, int height_px);

}  // namespace slicecorr::detail
