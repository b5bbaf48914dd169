// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// How much a packed file may unpack to.
#pragma once

#include <algorithm>
#include <cstdint>

namespace slicecorr::detail {

/// Small files that unpack to what fills a memory are made on purpose; whoever packs 256 MiB of
/// zeros fills none with them. `ratio`: more than what sound files of the kind reach.
constexpr std::uint64_t most_unpacked_bytes(std::uint64_t packed_bytes, std::uint64_t ratio) {
  constexpr std::uint64_t always_allowed = std::uint64_t{256} << 20;
  return std::max(always_allowed, ratio * packed_bytes);
}

}  // namespace slicecorr::detail
