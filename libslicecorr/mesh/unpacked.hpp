// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// How much a packed mesh may unpack to.
#pragma once

#include <cstdint>

namespace slicecorr::detail {

inline constexpr std::uint64_t kMostUnpackedBytes = std::uint64_t{2} << 30;
/// Meshes get a twentieth of their size at the least, as text of few different numbers; XML of one
/// triangle after the other packs to a tenth as a rule.
inline constexpr std::uint64_t kLargestRatio = 100;

}  // namespace slicecorr::detail
