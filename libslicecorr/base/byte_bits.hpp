// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// A bit of each of 64 bytes, the first byte in the lowest bit.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>

namespace slicecorr::detail {

/// The lowest bits of eight bytes in memory order, one after the other.
inline std::uint64_t gathered_bits(std::uint64_t eight) {
  return (eight & 0x0101010101010101U) * 0x0102040810204080U >> 56;
}

/// The highest bits of 64 bytes.
inline std::uint64_t high_bits(const std::uint8_t* bytes) {
  std::uint64_t bits = 0;
  for (std::size_t i = 0; i < 8; ++i) {
    std::uint64_t eight = 0;
    std::memcpy(&eight, bytes + 8 * i, 8);
    bits |= gathered_bits(eight >> 7) << (8 * i);
  }
  return bits;
}

/// Which of 64 bytes differ.
inline std::uint64_t differing(const std::uint8_t* bytes, const std::uint8_t* others) {
  std::uint64_t bits = 0;
  if (std::memcmp(bytes, others, 64) == 0) return bits;
  for (std::size_t i = 0; i < 8; ++i) {
    std::uint64_t eight = 0, other = 0;
    std::memcpy(&eight, bytes + 8 * i, 8);
    std::memcpy(&other, others + 8 * i, 8);
    eight ^= other;
    eight |= eight >> 4;
    eight |= eight >> 2;
    eight |= eight >> 1;
    bits |= gathered_bits(eight) << (8 * i);
  }
  return bits;
}

}  // namespace slicecorr::detail
