// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "base/run_length.hpp"

#include <algorithm>
#include <bit>
#include <cstring>
#include <iterator>

#include "base/run_end.hpp"
#include "slicecorr/error.hpp"

namespace slicecorr::detail {
namespace {

static_assert(std::endian::native == std::endian::little, "bytes are found by counting low bits");

enum Kind : std::uint8_t { zeros = 0, ones = 1, repeated = 2, plain = 3 };

/// Shorter runs stay among the plain bytes, so that a run always pays for the headers around it.
constexpr std::size_t kMinRun = 9;
constexpr std::size_t kLongLength = 64;

std::uint64_t load(const std::uint8_t* p) {
  std::uint64_t v;
  std::memcpy(&v, p, 8);
  return v;
}

/// Start of the next run of at least `kMinRun` bytes at or after `i`, or n.
std::size_t next_run(const std::uint8_t* data, std::size_t i, std::size_t n) {
  while (i + kMinRun <= n) {
    const std::uint64_t difference = load(data + i) ^ load(data + i + 1);
    if (difference == 0) return i;
    // No run can reach over the last pair of neighbours that differ.
    i += static_cast<std::size_t>(63 - std::countl_zero(difference)) / 8 + 1;
  }
  return n;
}

std::uint8_t* put_header(Kind kind, std::size_t length, std::uint8_t* out) {
  const std::size_t low = std::min(length, kLongLength) - 1;
  *out++ = static_cast<std::uint8_t>(kind << 6 | low);
  if (length < kLongLength) return out;
  std::size_t rest = length - kLongLength;
  for (; rest >= 128; rest >>= 7) *out++ = static_cast<std::uint8_t>(rest | 128);
  *out++ = static_cast<std::uint8_t>(rest);
  return out;
}

/// Most runs are short: eight bytes at a time, where so many more may be read and written.
constexpr std::size_t kShort = 64;
void copy_short(const std::uint8_t* from, std::size_t length, std::uint8_t* to) {
  for (std::size_t i = 0; i < length; i += 8) std::memcpy(to + i, from + i, 8);
}

[[noreturn]] void corrupt() { throw InputError("run-length code of an image is damaged"); }

}  // namespace

std::size_t run_end(const std::uint8_t* data, std::size_t i, std::size_t n) {
  const std::uint8_t value = data[i];
  const std::uint64_t pattern = value * 0x0101010101010101u;
  // Runs are usually long: four words a step, then the word that differs.
  while (i + 32 <= n && ((load(data + i) ^ pattern) | (load(data + i + 8) ^ pattern) |
                         (load(data + i + 16) ^ pattern) | (load(data + i + 24) ^ pattern)) == 0) {
    i += 32;
  }
  for (; i + 8 <= n; i += 8) {
    const std::uint64_t difference = load(data + i) ^ pattern;
    if (difference != 0) return i + static_cast<std::size_t>(std::countr_zero(difference)) / 8;
  }
  while (i < n && data[i] == value) ++i;
  return i;
}

void run_length_encode(const std::uint8_t* data, std::size_t n, std::vector<std::uint8_t>& out) {
  // A code is written here first, and goes on piece by piece.
  std::uint8_t piece[32 * kShort];
  std::uint8_t* to = piece;
  const auto pass_on = [&] {
    out.insert(out.end(), piece, to);
    to = piece;
  };
  for (std::size_t i = 0; i < n;) {
    const std::size_t start = next_run(data, i, n), length = start - i;
    // Room for two headers, a value and what is short.
    if (to + 2 * kShort > std::end(piece)) pass_on();
    if (length > 0) to = put_header(plain, length, to);
    if (length <= kShort && i + kShort <= n) {
      copy_short(data + i, length, to);
      to += length;
    } else {
      pass_on();
      out.insert(out.end(), data + i, data + start);
    }
    if (start == n) break;
    i = run_end(data, start, n);
    const std::uint8_t value = data[start];
    to = put_header(value == 0 ? zeros : value == 255 ? ones : repeated, i - start, to);
    if (value != 0 && value != 255) *to++ = value;
  }
  pass_on();
}

namespace {

/// Gives the runs of a code to `take(kind, bytes, length)`, where `bytes` are those that follow the
/// header.
template <class Take>
const std::uint8_t* each_run(const std::uint8_t* in, const std::uint8_t* end, std::size_t n,
                             const Take& take) {
  while (n > 0) {
    if (in == end) corrupt();
    const std::uint8_t header = *in++;
    std::size_t length = (header & 63u) + 1u;
    if (length == kLongLength) {
      for (int shift = 0;; shift += 7) {
        if (in == end || shift > 42) corrupt();
        const std::uint8_t byte = *in++;
        length += static_cast<std::size_t>(byte & 127u) << shift;
        if (byte < 128) break;
      }
    }
    if (length > n) corrupt();
    const int kind = header >> 6;
    const std::size_t bytes = kind == plain ? length : kind == repeated ? 1 : 0;
    if (static_cast<std::size_t>(end - in) < bytes) corrupt();
    take(kind, in, length);
    in += bytes;
    n -= length;
  }
  return in;
}

}  // namespace

const std::uint8_t* run_length_decode(const std::uint8_t* in, const std::uint8_t* end,
                                      std::uint8_t* data, std::size_t n) {
  std::uint8_t* const past = data + n;
  return each_run(in, end, n, [&](int kind, const std::uint8_t* bytes, std::size_t length) {
    const bool is_short = length <= kShort && kShort <= static_cast<std::size_t>(past - data);
    if (kind == plain) {
      if (is_short && kShort <= static_cast<std::size_t>(end - bytes)) {
        copy_short(bytes, length, data);
      } else {
        std::memcpy(data, bytes, length);
      }
    } else {
      const std::uint8_t value = kind == zeros ? 0 : kind == ones ? 255 : *bytes;
      if (is_short) {
        const std::uint64_t pattern = value * 0x0101010101010101U;
        for (std::size_t i = 0; i < length; i += 8) std::memcpy(data + i, &pattern, 8);
      } else {
        std::memset(data, value, length);
      }
    }
    data += length;
  });
}

const std::uint8_t* run_length_nonzero(const std::uint8_t* in, const std::uint8_t* end,
                                       std::size_t n, std::vector<NonZero>& out) {
  return run_length_nonzero(in, end, n, {0, n}, out);
}

const std::uint8_t* run_length_nonzero(const std::uint8_t* in, const std::uint8_t* end,
                                       std::size_t n, const ByteRange& range,
                                       std::vector<NonZero>& out) {
  // Whether a byte among others is 0 is nothing that a processor could predict: all are written, those that
  // are 0 are overwritten.
  constexpr std::size_t chunk = 64;
  NonZero room[chunk];
  std::size_t at = 0;
  return each_run(in, end, n, [&](int kind, const std::uint8_t* bytes, std::size_t length) {
    const std::size_t begin = at;
    at += length;
    if (kind == zeros || at <= range.first || begin >= range.past) return;
    const std::size_t first = std::max(begin, range.first), past = std::min(at, range.past);
    for (std::size_t from = first; from < past; from += chunk) {
      const std::size_t to = std::min(past, from + chunk);
      std::size_t count = 0;
      for (std::size_t i = from; i < to; ++i) {
        const std::uint8_t value = kind == plain  ? bytes[i - begin]
                                   : kind == ones ? std::uint8_t{255}
                                                  : *bytes;
        room[count] = {static_cast<std::uint32_t>(i), value};
        count += value != 0;
      }
      out.insert(out.end(), room, room + count);
    }
  });
}

}  // namespace slicecorr::detail
