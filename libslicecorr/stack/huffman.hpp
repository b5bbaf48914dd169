/// @file huffman.hpp
/// Canonical Huffman codes and the header of a dynamic block, as deflate (RFC 1951) has them.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

namespace slicecorr::detail {

/// Bits in the order of the stream, first bit lowest, and how many.
struct BitString {
  std::uint32_t bits = 0;
  std::uint32_t count = 0;
};

/// A code for symbols 0 to N - 1; `count` of a symbol without code is 0.
template <std::size_t N>
using HuffmanCode = std::array<BitString, N>;

/// Literals, the end of the block (256) and lengths; distances.
inline constexpr std::size_t literal_symbols = 286, distance_symbols = 30;
inline constexpr std::size_t end_of_block = 256, first_length = 257;

/// Shortest code of at most `limit` bits each for symbols that occur so often. Of less than two
/// symbols others get a code, too, so that no code is incomplete. Ties are broken by symbol: the
/// code follows from the frequencies alone.
void make_code(std::span<const std::uint32_t> frequencies, unsigned limit,
               std::span<BitString> code);

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
  void flush();
  /// Fills the last byte with zeros; returns the byte after it.
  std::uint8_t* finish();

 private:
  std::uint8_t* to_;
  std::uint64_t waiting_ = 0;
  std::uint32_t count_ = 0;
};

/// The header of a block, not the last one, that tells its codes.
class DynamicHeader {
 public:
  void make(const HuffmanCode<literal_symbols>& literals,
            const HuffmanCode<distance_symbols>& distances);
  std::uint64_t bit_count() const { return bit_count_; }
  void write(BitWriter& out) const;

 private:
  void add(std::uint32_t bits, std::uint32_t count) {
    parts_[size_++] = {bits, count};
    bit_count_ += count;
  }
  std::array<BitString, 4 + 19 + literal_symbols + distance_symbols> parts_;
  std::size_t size_ = 0;
  std::uint64_t bit_count_ = 0;
};

}  // namespace slicecorr::detail
