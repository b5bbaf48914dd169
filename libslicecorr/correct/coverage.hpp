// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Coverage of layers, 0..255.
#pragma once

#include <cstdint>

namespace slicecorr::detail {

inline constexpr std::uint8_t kFull = 255;

/// Stands for what is left alone where a grey that asks nothing does: it is no feature and no gap.
inline constexpr std::uint8_t kLeftAlone = 128;

inline bool is_grey(std::uint8_t coverage) { return coverage != 0 && coverage != kFull; }

/// Relative dose that a coverage aims at.
inline double aim_of(std::uint8_t coverage) { return coverage / 255.0; }

}  // namespace slicecorr::detail
