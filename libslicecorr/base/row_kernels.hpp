/// What is asked of all pixels of a row, 64 at a time, in the widest registers there are.
#pragma once

#include <cstddef>
#include <cstdint>

namespace slicecorr::detail {

/// Pixels, or columns, that share a word of bits.
inline constexpr std::size_t kRowWord = 64;

/// Bit i of word w: whether pixels[64 w + i] differs from the one before. There is one before the
/// first.
void find_changes(const std::uint8_t* pixels, std::size_t words, std::uint64_t* changes);

/// Bit i of word w: whether pixels[64 w + i] is not 0. Returns the sum of all of them.
std::uint64_t find_lit(const std::uint8_t* pixels, std::size_t words, std::uint64_t* lit);

}  // namespace slicecorr::detail
