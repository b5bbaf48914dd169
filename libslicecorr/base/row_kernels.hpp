// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Questions to all pixels of a row, answered 64 at a time in the widest registers there are.
#pragma once

#include <cstddef>
#include <cstdint>

namespace slicecorr::detail {

/// Number of pixels, or columns, whose bits make a word.
inline constexpr std::size_t kRowWord = 64;

/// Bit i of word w: whether pixels[64 w + i] differs from the pixel before it. pixels[-1] must be
/// readable.
void find_changes(const std::uint8_t* pixels, std::size_t words, std::uint64_t* changes);

/// Bit i of word w: whether pixels[64 w + i] is not 0. Returns the sum of all of them.
std::uint64_t find_lit(const std::uint8_t* pixels, std::size_t words, std::uint64_t* lit);

/// Copies `words` words of pixels. Bit i of greys[w]: whether pixels[64 w + i] is neither 0 nor 255.
/// Returns whether any is.
bool copy_and_find_greys(const std::uint8_t* pixels, std::size_t words, std::uint8_t* copy,
                         std::uint64_t* greys);

}  // namespace slicecorr::detail
