#include "stack/huffman.hpp"

#include <algorithm>
#include <bit>
#include <cstring>

namespace slicecorr::detail {
namespace {

static_assert(std::endian::native == std::endian::little, "bits are stored as words");

constexpr std::size_t most_symbols = 288;
constexpr unsigned longest = 15;

std::uint32_t reversed(std::uint32_t bits, unsigned count) {
  bits = (bits & 0x5555u) << 1 | (bits >> 1 & 0x5555u);
  bits = (bits & 0x3333u) << 2 | (bits >> 2 & 0x3333u);
  bits = (bits & 0x0f0fu) << 4 | (bits >> 4 & 0x0f0fu);
  bits = (bits & 0x00ffu) << 8 | (bits >> 8 & 0x00ffu);
  return bits >> (16 - count);
}

/// Bits of canonical codes from the number of bits of each.
void number(std::span<BitString> code) {
  std::array<std::uint32_t, longest + 2> counts{}, next{};
  for (const BitString& s : code) ++counts[s.count];
  counts[0] = 0;
  for (unsigned length = 1, first = 0; length <= longest; ++length) {
    first = (first + counts[length - 1]) << 1;
    next[length] = first;
  }
  for (BitString& s : code) s.bits = s.count == 0 ? 0 : reversed(next[s.count]++, s.count);
}

/// Turns `a`, rising frequencies of n >= 2 symbols, into depths in their Huffman tree, in place:
/// Moffat and Katajainen, "In-place calculation of minimum-redundancy codes" (1995).
void depths(std::uint32_t* a, int n) {
  // Left to right: inner nodes, whose place takes their parent.
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

}  // namespace

void make_code(std::span<const std::uint32_t> frequencies, unsigned limit,
               std::span<BitString> code) {
  // Frequency and symbol in one number: sorted, ties have an order. Sums stay below 2^32.
  std::array<std::uint32_t, most_symbols> keys;
  int n = 0;
  for (std::size_t i = 0; i < frequencies.size(); ++i) {
    code[i] = {};
    if (frequencies[i] == 0) continue;
    keys[static_cast<std::size_t>(n++)] =
        std::min<std::uint32_t>(frequencies[i], (1u << 22) - 1) << 9 | static_cast<unsigned>(i);
  }
  // A code of one symbol has no bits in principle, but deflate's have; and some readers don't like
  // a code with unused ends.
  for (std::uint32_t i = 0; n < 2; ++i) {
    if (frequencies[i] == 0) keys[static_cast<std::size_t>(n++)] = 1u << 9 | i;
  }
  std::sort(keys.begin(), keys.begin() + n);
  std::array<std::uint32_t, most_symbols> length;
  for (int i = 0; i < n; ++i) {
    length[static_cast<std::size_t>(i)] = keys[static_cast<std::size_t>(i)] >> 9;
  }
  depths(length.data(), n);
  // Where codes are too long: cut them off, then make others longer until all fit. Only how many
  // there are of each length matters.
  std::array<std::uint32_t, most_symbols> counts{};
  for (int i = 0; i < n; ++i) ++counts[std::min(length[static_cast<std::size_t>(i)], limit)];
  std::uint32_t space = 0;
  for (unsigned l = 1; l <= limit; ++l) space += counts[l] << (limit - l);
  for (; space > 1u << limit; --space) {
    --counts[limit];
    unsigned l = limit - 1;
    while (counts[l] == 0) --l;
    --counts[l];
    counts[l + 1] += 2;
  }
  int at = 0;
  for (unsigned l = limit; l > 0; --l) {
    for (std::uint32_t i = 0; i < counts[l]; ++i) {
      code[keys[static_cast<std::size_t>(at++)] & 511].count = l;
    }
  }
  number(code.first(frequencies.size()));
}

void BitWriter::flush() {
  std::memcpy(to_, &waiting_, 8);
  to_ += count_ >> 3;
  waiting_ >>= count_ & ~7u;
  count_ &= 7;
}

std::uint8_t* BitWriter::finish() {
  count_ = (count_ + 7) & ~7u;
  flush();
  return to_;
}

void DynamicHeader::make(const HuffmanCode<literal_symbols>& literals,
                         const HuffmanCode<distance_symbols>& distances) {
  size_ = 0;
  bit_count_ = 0;
  std::size_t literal_count = literals.size(), distance_count = distances.size();
  while (literal_count > 257 && literals[literal_count - 1].count == 0) --literal_count;
  while (distance_count > 1 && distances[distance_count - 1].count == 0) --distance_count;
  std::array<std::uint8_t, literal_symbols + distance_symbols> lengths;
  std::size_t n = 0;
  for (std::size_t i = 0; i < literal_count; ++i) {
    lengths[n++] = static_cast<std::uint8_t>(literals[i].count);
  }
  for (std::size_t i = 0; i < distance_count; ++i) {
    lengths[n++] = static_cast<std::uint8_t>(distances[i].count);
  }
  // Runs of lengths: 16 repeats the last 3 to 6 times, 17 and 18 are 3 to 10 and 11 to 138 zeros.
  struct Word {
    std::uint8_t symbol, extra_bits;
    std::uint32_t extra;
  };
  std::array<Word, literal_symbols + distance_symbols> words;
  std::array<std::uint32_t, 19> frequencies{};
  std::size_t word_count = 0;
  const auto word = [&](std::uint8_t symbol, std::uint8_t extra_bits, std::size_t extra) {
    words[word_count++] = {symbol, extra_bits, static_cast<std::uint32_t>(extra)};
    ++frequencies[symbol];
  };
  for (std::size_t i = 0; i < n;) {
    const std::uint8_t length = lengths[i];
    std::size_t run = 1;
    while (i + run < n && lengths[i + run] == length) ++run;
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
  std::array<BitString, 19> code;
  make_code(frequencies, 7, code);
  constexpr std::array<std::uint8_t, 19> order = {16, 17, 18, 0, 8,  7, 9,  6, 10, 5,
                                                  11, 4,  12, 3, 13, 2, 14, 1, 15};
  std::size_t code_count = order.size();
  while (code_count > 4 && code[order[code_count - 1]].count == 0) --code_count;
  add(2 << 1, 3);  // not the last block; codes of its own
  add(static_cast<std::uint32_t>(literal_count - 257), 5);
  add(static_cast<std::uint32_t>(distance_count - 1), 5);
  add(static_cast<std::uint32_t>(code_count - 4), 4);
  for (std::size_t i = 0; i < code_count; ++i) add(code[order[i]].count, 3);
  for (std::size_t i = 0; i < word_count; ++i) {
    const BitString& s = code[words[i].symbol];
    add(s.bits | words[i].extra << s.count, s.count + words[i].extra_bits);
  }
}

void DynamicHeader::write(BitWriter& out) const {
  for (std::size_t i = 0; i < size_; ++i) {
    out.put(parts_[i]);
    out.flush();
  }
}

}  // namespace slicecorr::detail
