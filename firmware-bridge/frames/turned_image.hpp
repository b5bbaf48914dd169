// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Images turned to how a display shows them.
#pragma once

#include <cstdint>
#include <vector>

#include "slicecorr/orientation.hpp"

namespace slicecorr::bridge {

/// `image` of `width_px` x `height_px` pixels, row by row, after a turn.
std::vector<std::uint8_t> turned_image(std::vector<std::uint8_t> image, const Turn& turn,
                                       int width_px, int height_px);

}  // namespace slicecorr::bridge
