// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "stack/png/huffman.hpp"

#include <algorithm>
#include <cstring>
#include <utility>

namespace slicecorr::detail {
namespace {

constexpr unsigned kLongest = 15;

std::uint16_t reversed(std::uint32_t bits, unsigned count) {
  bits = (bits & 0x5555u) << 1 | (bits >> 1 & 0x5555u);
  bits = (bits & 0x3333u) << 2 | (bits >> 2 & 0x3333u);
  bits = (bits & 0x0f0fu) << 4 | (bits >> 4 & 0x0f0fu);
  bits = (bits & 0x00ffu) << 8 | (bits >> 8 & 0x00ffu);
  return static_cast<std::uint16_t>(bits >> (16 - count));
}

/// Turns `a`, rising frequencies of n >= 2 symbols, into depths in their Huffman tree, in place:
/// Moffat and Katajainen, "In-place calculation of minimum-redundancy codes" (1995).
void depths(std::uint32_t* a, int n) {
  // Left to right: makes the inner nodes; the place of each then holds its parent.
  a[0] += a[1];
  int root = 0, leaf = 2;
  for (int next = 1; next < n - 1; ++next) {
    const auto lighter = [&] {
      const bool inner = leaf >= n || (root < next && a[root] < a[leaf]);
      const std::uint32_t weight = inner ? a[root] : a[leaf++];
      if (inner) a[root++] = static_cast<std::uint32_t>(next);
      return weight;
    };
    const std::uint32_t weight = lighter();
    a[next] = weight + lighter();
  }
  // Right to left: depths of inner nodes.
  a[n - 2] = 0;
  for (int next = n - 3; next >= 0; --next) a[next] = a[a[next]] + 1;
  // Right to left: depths of leaves.
  int available = 1, used = 0;
  std::uint32_t depth = 0;
  root = n - 2;
  for (int next = n - 1; available > 0; ++depth) {
    for (; root >= 0 && a[root] == depth; --root) ++used;
    for (; available > used; --available) a[next--] = depth;
    available = 2 * used;
    used = 0;
  }
}

/// Sorts keys: a frequency above the 9 bits of its symbol, so that equal frequencies come in the
/// order of symbols. Most frequencies are small: those are sorted by counting, the others by
/// comparing.
void sort_keys(const std::uint32_t* keys, std::size_t n, std::uint32_t* sorted) {
  constexpr std::uint32_t large = 128;
  const auto bucket = [](std::uint32_t key) { return key >> 9 < large ? key >> 9 : large; };
  std::array<std::uint16_t, large + 2> begin{};
  for (std::size_t i = 0; i < n; ++i) ++begin[bucket(keys[i]) + 1];
  for (std::size_t b = 1; b < begin.size(); ++b) {
    begin[b] = static_cast<std::uint16_t>(begin[b] + begin[b - 1]);
  }
  const std::size_t first_large = begin[large];
  for (std::size_t i = 0; i < n; ++i) sorted[begin[bucket(keys[i])]++] = keys[i];
  std::sort(sorted + first_large, sorted + n);
}

}  // namespace

std::uint64_t HuffmanCode::make(std::span<const std::uint32_t> frequencies, unsigned limit) {
  // Frequency and symbol in one number: sorted, ties have an order. Sums stay below 2^32.
  constexpr std::uint32_t symbol_mask = 511;
  std::array<std::uint32_t, kMostSymbols> keys, sorted{}, depth;
  std::size_t n = 0;
  for (std::size_t i = 0; i < frequencies.size(); ++i) {
    if (frequencies[i] == 0) continue;
    keys[n++] = std::min(frequencies[i], (1u << 22) - 1) << 9 | static_cast<std::uint32_t>(i);
  }
  // Deflate needs one bit even for a code of a single symbol, and some readers refuse a code in
  // which not all bit strings are used: other symbols are added.
  for (std::uint32_t i = 0; n < 2; ++i) {
    if (frequencies[i] == 0) keys[n++] = 1u << 9 | i;
  }
  if (n == 2 && (keys[0] & symbol_mask) > (keys[1] & symbol_mask)) std::swap(keys[0], keys[1]);
  sort_keys(keys.data(), n, sorted.data());
  for (std::size_t i = 0; i < n; ++i) depth[i] = sorted[i] >> 9;
  depths(depth.data(), static_cast<int>(n));

  // Codes that are too long are cut off, then others made longer until all fit. Only the number of
  // codes of each length matters for that.
  std::array<std::uint32_t, kLongest + 1> counts{};
  for (std::size_t i = 0; i < n; ++i) ++counts[std::min(depth[i], limit)];
  std::uint32_t space = 0;
  for (unsigned l = 1; l <= limit; ++l) space += counts[l] << (limit - l);
  for (; space > 1u << limit; --space) {
    --counts[limit];
    unsigned l = limit - 1;
    while (counts[l] == 0) --l;
    --counts[l];
    counts[l + 1] += 2;
  }
  bit_counts_.fill(0);
  strings_.fill({});
  for (std::size_t l = limit, at = 0; l > 0; --l) {
    for (std::uint32_t i = 0; i < counts[l]; ++i) {
      bit_counts_[sorted[at++] & symbol_mask] = static_cast<std::uint8_t>(l);
    }
  }
  // Canonical codes rise with their length, then with the symbol.
  std::array<std::uint32_t, kLongest + 1> next{};
  for (std::size_t l = 1; l <= limit; ++l) {
    next[l] = (next[l - 1] + (l == 1 ? 0 : counts[l - 1])) << 1;
  }
  std::uint64_t bits = 0;
  for (std::size_t i = 0; i < n; ++i) {
    const std::size_t symbol = keys[i] & symbol_mask;
    const std::uint8_t length = bit_counts_[symbol];
    strings_[symbol] = {reversed(next[length]++, length), length};
    bits += std::uint64_t{frequencies[symbol]} * length;
  }
  size_ = (keys[n - 1] & symbol_mask) + 1;
  return bits;
}

void DynamicHeader::make(const HuffmanCode& literals, const HuffmanCode& distances) {
  size_ = 0;
  bit_count_ = 0;
  const std::span<const std::uint8_t> near = literals.bit_counts(), far = distances.bit_counts();
  std::array<std::uint8_t, kLiteralSymbols + kDistanceSymbols + 8> lengths;
  std::copy(near.begin(), near.end(), lengths.begin());
  std::copy(far.begin(), far.end(), lengths.begin() + static_cast<std::ptrdiff_t>(near.size()));
  const std::size_t n = near.size() + far.size();
  std::fill_n(lengths.begin() + static_cast<std::ptrdiff_t>(n), 8, std::uint8_t{255});
  // Runs of lengths: 16 repeats the last 3 to 6 times, 17 and 18 are 3 to 10 and 11 to 138 zeros.
  struct Word {
    std::uint8_t symbol, extra_bits;
    std::uint32_t extra;
  };
  std::array<Word, kLiteralSymbols + kDistanceSymbols> words;
  std::array<std::uint32_t, 19> frequencies{};
  std::size_t word_count = 0;
  const auto word = [&](std::uint8_t symbol, std::uint8_t extra_bits, std::size_t extra) {
    words[word_count++] = {symbol, extra_bits, static_cast<std::uint32_t>(extra)};
    ++frequencies[symbol];
  };
  for (std::size_t i = 0; i < n;) {
    const std::uint8_t length = lengths[i];
    std::size_t run = 1;
    for (std::uint64_t eight = 0; length == 0; run += 8) {
      std::memcpy(&eight, &lengths[i + run], 8);
      if (eight != 0) break;
    }
    while (lengths[i + run] == length) ++run;
    i += run;
    if (length == 0) {
      for (; run >= 11; run -= std::min<std::size_t>(run, 138)) {
        word(18, 7, std::min<std::size_t>(run, 138) - 11);
      }
      if (run >= 3) {
        word(17, 3, run - 3);
        run = 0;
      }
    } else {
      word(length, 0, 0);
      for (--run; run >= 3; run -= std::min<std::size_t>(run, 6)) {
        word(16, 2, std::min<std::size_t>(run, 6) - 3);
      }
    }
    for (; run > 0; --run) word(length, 0, 0);
  }
  HuffmanCode code;
  code.make(frequencies, 7);
  constexpr std::array<std::uint8_t, 19> order = {16, 17, 18, 0, 8,  7, 9,  6, 10, 5,
                                                  11, 4,  12, 3, 13, 2, 14, 1, 15};
  std::size_t code_count = order.size();
  while (code_count > 4 && code[order[code_count - 1]].count == 0) --code_count;
  add(2 << 1, 3);  // not the last block; codes of its own
  add(near.size() - kFirstLength, 5);
  add(far.size() - 1, 5);
  add(code_count - 4, 4);
  for (std::size_t i = 0; i < code_count; ++i) add(code[order[i]].count, 3);
  for (std::size_t i = 0; i < word_count; ++i) {
    const BitString& s = code[words[i].symbol];
    add(s.bits | words[i].extra << s.count, std::uint32_t{s.count} + words[i].extra_bits);
  }
}

void DynamicHeader::write(BitWriter& out) const {
  for (std::size_t i = 0; i < size_; ++i) {
    out.put(parts_[i]);
    out.flush();
  }
}

}  // namespace slicecorr::detail
