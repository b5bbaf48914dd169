// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Frames as a display's memory has them: 32 bits to a pixel, blue and UV images in channels.
#pragma once

#include <cstddef>
#include <cstdint>

#include "slicecorr/bridge/frames.hpp"

namespace slicecorr::bridge {

/// Writes all pixels of a picture of `width_px` x `height_px`, 0xFFRRGGBB, rows `pitch_px` apart.
/// Null, or a black frame, is black. Throws `Error` when the frame has another size.
void pack(const Frame* frame, const Projector& channels, int width_px, int height_px,
          std::uint32_t* out, std::size_t pitch_px);

}  // namespace slicecorr::bridge
