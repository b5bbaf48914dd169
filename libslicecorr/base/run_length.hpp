// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file run_length.hpp
/// Byte runs: slices are mostly long runs of black and of full light.
///
/// Code: a header byte with the kind in its two high bits (0: zeros, 1: bytes 255, 2: one repeated
/// byte, which follows, 3: plain bytes, which follow) and length - 1 in the six low ones. When
/// these are 63, length - 64 follows as a little-endian base 128 number, before the data.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace slicecorr::detail {

/// Appends the code of `n` bytes to `out`: never more than n + n / 64 + 2 bytes.
void run_length_encode(const std::uint8_t* data, std::size_t n, std::vector<std::uint8_t>& out);

/// Decodes exactly `n` bytes and returns the first byte after their code. Throws `InputError` when
/// the code ends too early or gives more than `n` bytes; never reads or writes beyond either.
const std::uint8_t* run_length_decode(const std::uint8_t* in, const std::uint8_t* end,
                                      std::uint8_t* data, std::size_t n);

/// A byte that is not 0, and where it is.
struct NonZero {
  std::uint32_t at;
  std::uint8_t value;
};
/// The same code without its zeros: appends what else there is, in order.
const std::uint8_t* run_length_nonzero(const std::uint8_t* in, const std::uint8_t* end,
                                       std::size_t n, std::vector<NonZero>& out);
/// Some of the bytes of a code.
struct ByteRange {
  std::size_t first = 0, past = 0;
};
/// The same of some bytes only.
const std::uint8_t* run_length_nonzero(const std::uint8_t* in, const std::uint8_t* end,
                                       std::size_t n, const ByteRange& range,
                                       std::vector<NonZero>& out);

}  // namespace slicecorr::detail
