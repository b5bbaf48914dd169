/// Coverage of layers, 0..255.
#pragma once

#include <cstdint>

namespace slicecorr::detail {

inline constexpr std::uint8_t kFull = 255;

/// Relative dose that a coverage aims at.
inline double aim_of(std::uint8_t coverage) { return coverage / 255.0; }

}  // namespace slicecorr::detail
