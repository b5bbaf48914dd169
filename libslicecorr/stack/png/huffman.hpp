// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file huffman.hpp
/// Canonical Huffman codes and the header of a dynamic block, as deflate (RFC 1951) has them.
#pragma once

#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <span>

namespace slicecorr::detail {

/// Bits in the order of the stream, first bit lowest, and how many.
struct BitString {
  std::uint16_t bits = 0;
  std::uint16_t count = 0;
};

/// Numbers of symbols: literals, the end of the block (256) and lengths; distances.
inline constexpr std::size_t kLiteralSymbols = 286, kDistanceSymbols = 30;
inline constexpr std::size_t kEndOfBlock = 256, kFirstLength = 257;

/// A code for the symbols that occur; the others have none.
class HuffmanCode {
 public:
  /// Makes the shortest code of at most `limit` bits each. Of less than two symbols others get a
  /// code, too: no code is incomplete. Ties are broken by symbol, so that the code follows from
  /// the frequencies alone. Returns the bits of all occurrences together.
  std::uint64_t make(std::span<const std::uint32_t> frequencies, unsigned limit);
  const BitString& operator[](std::size_t symbol) const { return strings_[symbol]; }
  const BitString* data() const { return strings_.data(); }
  /// Number of bits by symbol, without the symbols at the end that have no code.
  std::span<const std::uint8_t> bit_counts() const { return {bit_counts_.data(), size_}; }

 private:
  static constexpr std::size_t kMostSymbols = 288;
  std::array<BitString, kMostSymbols> strings_;
  std::array<std::uint8_t, kMostSymbols> bit_counts_;
  std::size_t size_ = 0;
};

/// Writes bits, first bit lowest, into memory that is large enough: eight bytes beyond the last
/// bit are touched.
class BitWriter {
 public:
  explicit BitWriter(std::uint8_t* to) : to_(to) {}
  /// At most 56 bits between two calls of `flush`.
  void put(std::uint64_t bits, std::uint32_t count) {
    waiting_ |= bits << count_;
    count_ += count;
  }
  void put(const BitString& s) { put(s.bits, s.count); }
  void flush() {
    static_assert(std::endian::native == std::endian::little, "bits are stored as words");
    std::memcpy(to_, &waiting_, 8);
    to_ += count_ >> 3;
    waiting_ >>= count_ & ~7u;
    count_ &= 7;
  }
  /// Fills the last byte with zeros; returns the byte after it.
  std::uint8_t* finish() {
    count_ = (count_ + 7) & ~7u;
    flush();
    return to_;
  }

 private:
  std::uint8_t* to_;
  std::uint64_t waiting_ = 0;
  std::uint32_t count_ = 0;
};

/// The header of a block, not the last one, that tells its codes.
class DynamicHeader {
 public:
  void make(const HuffmanCode& literals, const HuffmanCode& distances);
  std::uint64_t bit_count() const { return bit_count_; }
  void write(BitWriter& out) const;

 private:
  void add(std::size_t bits, std::uint32_t count) {
    parts_[size_++] = {static_cast<std::uint16_t>(bits), static_cast<std::uint16_t>(count)};
    bit_count_ += count;
  }
  std::array<BitString, 4 + 19 + kLiteralSymbols + kDistanceSymbols> parts_;
  std::size_t size_ = 0;
  std::uint64_t bit_count_ = 0;
};

}  // namespace slicecorr::detail
