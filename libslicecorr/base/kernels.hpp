// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What hot loops share: blocks of columns, and one function compiled for several instruction sets.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>

/// Compiles a function for AVX-512, AVX2 and the baseline and picks at run time. Results are the
/// same: contraction of floating-point operations is off everywhere. Resolvers run before
/// sanitizers do.
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__) && \
    !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
#define SLICECORR_CLONES \
  __attribute__((target_clones("arch=x86-64-v4", "arch=x86-64-v3", "default"), noinline))
#else
#define SLICECORR_CLONES
#endif

namespace slicecorr::detail {

/// Columns that are looked at together: coverage of a block fits one vector register.
inline constexpr std::size_t kBlock = 32;

/// Bitwise or, and bitwise and, of the 32 bytes of a block, eight lanes each.
struct BlockBits {
  std::uint64_t any, all;
};
inline BlockBits block_bits(const std::uint8_t* p) {
  std::uint64_t w[4];
  std::memcpy(w, p, sizeof w);
  return {w[0] | w[1] | w[2] | w[3], w[0] & w[1] & w[2] & w[3]};
}
/// True when all 32 bytes are the same.
inline bool uniform(const std::uint8_t* p) {
  const BlockBits bits = block_bits(p);
  return bits.any == bits.all && bits.any == p[0] * 0x0101010101010101ULL;
}

}  // namespace slicecorr::detail
