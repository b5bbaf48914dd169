// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "stack/png/run_deflate.hpp"

#include <algorithm>
#include <bit>
#include <cstring>

#include "base/row_kernels.hpp"

namespace slicecorr::detail {
namespace {

constexpr std::uint32_t kNoValue = 256;
constexpr std::uint32_t kLeastMatch = 3, kLongestMatch = 258, kFarthest = 32768;
/// Longest code, bits: four literals, or a whole match, then fit between two flushes.
constexpr unsigned kCodeLimit = 12;

/// Length symbols: code, number of extra bits and least length of each.
struct LengthTable {
  std::array<std::uint8_t, kLongestMatch + 1> code{};
  std::array<std::uint8_t, 29> extra{};
  std::array<std::uint16_t, 29> base{};
  constexpr LengthTable() {
    unsigned length = kLeastMatch;
    for (unsigned c = 0; c < 28; ++c) {
      extra[c] = static_cast<std::uint8_t>(c < 8 ? 0 : c / 4 - 1);
      base[c] = static_cast<std::uint16_t>(length);
      for (unsigned i = 0; i < 1u << extra[c] && length < kLongestMatch; ++i) {
        code[length++] = static_cast<std::uint8_t>(c);
      }
    }
    code[kLongestMatch] = 28;
    base[28] = kLongestMatch;
  }
};
constexpr LengthTable kLengths;

struct Distance {
  std::uint32_t symbol, extra_bits, extra;
};
Distance distance_of(std::uint32_t distance) {
  const std::uint32_t d = distance - 1;
  if (d < 4) return {d, 0, 0};
  const auto bits = static_cast<std::uint32_t>(std::bit_width(d)) - 2;
  return {2 * bits + 2 + (d >> bits & 1), bits, d & ((1u << bits) - 1)};
}

/// Calls `take(length, times)` for matches that together have this length.
template <class Take>
void split(std::uint32_t length, const Take& take) {
  if (length <= kLongestMatch) {
    take(length, 1u);
    return;
  }
  const std::uint32_t times = length / kLongestMatch, rest = length % kLongestMatch;
  if (rest == 0 || rest >= kLeastMatch) {
    take(kLongestMatch, times);
    if (rest != 0) take(rest, 1u);
  } else {
    if (times > 1) take(kLongestMatch, times - 1);
    take(kLongestMatch + rest - kLeastMatch, 1u);
    take(kLeastMatch, 1u);
  }
}

constexpr std::size_t kBlock = kRowWord;

/// Up to eight literals as a number; there are eight readable bytes.
std::uint64_t load(const std::uint8_t* p, std::uint32_t count) {
  std::uint64_t v;
  std::memcpy(&v, p, 8);
  return count >= 8 ? v : v & ((std::uint64_t{1} << 8 * count) - 1);
}

constexpr unsigned kHashBits = 11;

}  // namespace

void RunDeflater::clear() {
  if (written_) std::swap(now_, last_);
  written_ = false;
  now_.literal_count = now_.token_count = token_start_ = run_ = 0;
  value_ = kNoValue;
}

/// Makes room for `n` more bytes, whatever they are, and for what is written beyond the last.
void RunDeflater::make_room(std::size_t n) {
  if (now_.literals.size() < now_.literal_count + n + kBlock + 8) {
    now_.literals.resize(2 * (now_.literal_count + n + kBlock));
  }
  if (now_.tokens.size() < now_.token_count + n / 4 + 4)
    now_.tokens.resize(2 * (now_.token_count + n / 4 + 4));
}

void RunDeflater::end_run() {
  if (run_ >= kLeastMatch) {
    now_.tokens[now_.token_count++] = {
        static_cast<std::uint32_t>(now_.literal_count - token_start_),
        static_cast<std::uint32_t>(run_)};
    token_start_ = now_.literal_count;
  } else {
    now_.literals[now_.literal_count] = now_.literals[now_.literal_count + 1] =
        static_cast<std::uint8_t>(value_);
    now_.literal_count += run_;
  }
  run_ = 0;
}

void RunDeflater::start_run(std::uint8_t value) {
  value_ = value;
  now_.literals[now_.literal_count++] = value;
}

void RunDeflater::add_byte(std::uint8_t value) {
  if (value == value_) {
    ++run_;
    return;
  }
  make_room(4);
  end_run();
  start_run(value);
}

void RunDeflater::add_zeros(std::size_t n) {
  if (n == 0) return;
  add_byte(0);
  run_ += n - 1;
}

void RunDeflater::add(const std::uint8_t* bytes, std::size_t n) {
  if (n == 0) return;
  add_byte(bytes[0]);
  make_room(n);
  const std::size_t blocks = (n - 1) / kBlock;
  if (changes_.size() <= blocks) changes_.resize(blocks + 1);
  find_changes(bytes + 1, blocks, changes_.data());
  std::size_t i = 1;
  for (std::size_t b = 0; b < blocks; ++b, i += kBlock) {
    const std::uint64_t starts = changes_[b];
    if (starts == 0) {
      run_ += kBlock;
    } else {
      add_block(bytes + i, 0, starts);
    }
  }
  if (i < n && n > kBlock) {
    // The last block overlaps the one before.
    const std::size_t done = i - (n - kBlock);
    find_changes(bytes + n - kBlock, 1, changes_.data());
    add_block(bytes + n - kBlock, done, changes_[0] >> done << done);
    return;
  }
  for (; i < n; ++i) {
    if (bytes[i] == value_) {
      ++run_;
    } else {
      end_run();
      start_run(bytes[i]);
    }
  }
}

/// Bytes of a block from the one at `at` on. Bits of `starts`: where another value starts.
void RunDeflater::add_block(const std::uint8_t* bytes, std::size_t at, std::uint64_t starts) {
  const std::uint64_t equal = ~starts;
  // Where a byte and the two after it equal the one before it.
  const std::uint64_t runs = equal & equal >> 1 & equal >> 2;
  const auto take_literals = [&](std::size_t n) {
    std::uint8_t* const to = &now_.literals[now_.literal_count];
    if (n <= 8 && at + 8 <= kBlock) {
      std::memcpy(to, bytes + at, 8);
    } else {
      std::memcpy(to, bytes + at, n);
    }
    now_.literal_count += n;
  };
  for (;;) {
    const auto more = static_cast<std::size_t>(std::countr_one(equal >> at));
    run_ += more;
    at += more;
    if (at == kBlock) return;
    end_run();
    const std::uint64_t later = runs >> at;
    if (later == 0) {
      // One or two equal bytes at the end may become a run in the next block.
      const auto tail = static_cast<std::size_t>(std::countl_one(equal));
      take_literals(kBlock - at - tail);
      value_ = bytes[kBlock - 1];
      run_ = tail;
      return;
    }
    const auto n = static_cast<std::size_t>(std::countr_zero(later));
    take_literals(n);
    at += n;
    value_ = bytes[at - 1];
  }
}

void RunDeflater::end() {
  if (value_ == kNoValue) return;
  make_room(4);
  end_run();
  value_ = kNoValue;
}

bool RunDeflater::only_zeros() const {
  const auto first = now_.literals.begin();
  return std::all_of(first, first + static_cast<std::ptrdiff_t>(now_.literal_count),
                     [](std::uint8_t literal) { return literal == 0; });
}

bool RunDeflater::repeats_last() const {
  const Tokens &a = written_ ? now_ : last_, &b = now_;
  return a.literal_count == b.literal_count && a.token_count == b.token_count &&
         std::equal(b.literals.begin(),
                    b.literals.begin() + static_cast<std::ptrdiff_t>(b.literal_count),
                    a.literals.begin()) &&
         std::equal(b.tokens.begin(), b.tokens.begin() + static_cast<std::ptrdiff_t>(b.token_count),
                    a.tokens.begin());
}

std::size_t RunDeflater::find_match(std::size_t at, std::size_t before) {
  const std::uint32_t distance = token_starts_[at].raw - token_starts_[before].raw;
  if (distance > kFarthest) return 0;
  std::uint32_t matched_literals = 0, length = 0, tokens = 0;
  for (; at + tokens < now_.token_count; ++tokens) {
    const Token& token = now_.tokens[at + tokens];
    if (token != now_.tokens[before + tokens] || length + token.literals > kLongestMatch) break;
    const std::uint8_t* const a = &now_.literals[token_starts_[at + tokens].literal];
    const std::uint8_t* const b = &now_.literals[token_starts_[before + tokens].literal];
    if (load(a, token.literals) != load(b, token.literals)) break;
    if (token.literals > 8 && std::memcmp(a, b, token.literals) != 0) break;
    matched_literals += token.literals;
    length += token.literals + token.run;
    if (length >= kLongestMatch) {
      ++tokens;
      break;
    }
  }
  // A match takes about as many bits as two or three literals and a run: fewer don't pay.
  if (tokens == 0 || (tokens == 1 && matched_literals < 3)) return 0;
  // The rest of the last run, beyond the longest match, stays a run.
  std::uint32_t rest = length > kLongestMatch ? length - kLongestMatch : 0;
  if (rest != 0 && rest < kLeastMatch) rest = kLeastMatch;
  matches_.push_back({0, matched_literals, length - rest, distance});
  if (rest != 0) matches_.push_back({0, 0, rest, 1});
  return tokens;
}

void RunDeflater::find_matches() {
  matches_.clear();
  if (token_starts_.size() < now_.token_count) token_starts_.resize(now_.tokens.size());
  if (seen_.empty()) seen_.resize(std::size_t{1} << kHashBits);
  if (first_id_ > 0x7fffffffu) {
    std::fill(seen_.begin(), seen_.end(), 0u);
    first_id_ = 1;
  }
  std::uint32_t raw = 0, literal = 0;
  for (std::size_t i = 0; i < now_.token_count; ++i) {
    token_starts_[i] = {raw, literal};
    raw += now_.tokens[i].literals + now_.tokens[i].run;
    literal += now_.tokens[i].literals;
  }
  for (std::size_t i = 0; i < now_.token_count;) {
    const Token& token = now_.tokens[i];
    std::uint64_t h = load(&now_.literals[token_starts_[i].literal], token.literals);
    h = (h ^ std::uint64_t{token.run} << 40 ^ std::uint64_t{token.literals} << 24) *
        0x9e3779b97f4a7c15u;
    std::uint32_t& seen = seen_[h >> (64 - kHashBits)];
    const std::uint32_t before = seen;
    seen = first_id_ + static_cast<std::uint32_t>(i);
    const std::size_t tokens = before < first_id_ ? 0 : find_match(i, before - first_id_);
    if (tokens == 0) matches_.push_back({token.literals, 0, token.run, 1});
    i += std::max<std::size_t>(tokens, 1);
  }
  first_id_ += static_cast<std::uint32_t>(now_.token_count);
}

void RunDeflater::count_symbols() {
  literal_frequencies_.fill(0);
  distance_frequencies_.fill(0);
  extra_bits_ = 0;
  // Counts all literals, then takes back those that matches hold. Several tables, because counting
  // equal bytes in one would wait for its own last store.
  std::array<std::array<std::uint32_t, 256>, 4> counts{};
  const std::uint8_t* literal = now_.literals.data();
  std::size_t i = 0;
  for (; i + 4 <= now_.literal_count; i += 4) {
    for (std::size_t k = 0; k < 4; ++k) ++counts[k][literal[i + k]];
  }
  for (; i < now_.literal_count; ++i) ++counts[0][literal[i]];
  for (std::size_t v = 0; v < 256; ++v) {
    literal_frequencies_[v] = counts[0][v] + counts[1][v] + counts[2][v] + counts[3][v];
  }
  for (const Match& match : matches_) {
    literal += match.literals;
    for (std::uint32_t k = 0; k < match.matched_literals; ++k) --literal_frequencies_[*literal++];
    const Distance distance = distance_of(match.distance);
    split(match.length, [&](std::uint32_t length, std::uint32_t times) {
      const std::uint8_t code = kLengths.code[length];
      literal_frequencies_[kFirstLength + code] += times;
      distance_frequencies_[distance.symbol] += times;
      extra_bits_ += std::uint64_t{times} * (kLengths.extra[code] + distance.extra_bits);
    });
  }
  literal_frequencies_[kEndOfBlock] = 1;
}

void RunDeflater::write_matches(BitWriter& out) const {
  const std::uint8_t* literal = now_.literals.data();
  const BitString* const codes = literal_code_.data();
  const auto put_literals = [&](std::size_t n) {
    for (; n >= 4; n -= 4, literal += 4) {
      out.put(codes[literal[0]]);
      out.put(codes[literal[1]]);
      out.put(codes[literal[2]]);
      out.put(codes[literal[3]]);
      out.flush();
    }
    for (; n > 0; --n) out.put(codes[*literal++]);
    out.flush();
  };
  std::size_t rest = now_.literal_count;
  for (const Match& match : matches_) {
    put_literals(match.literals);
    literal += match.matched_literals;
    rest -= match.literals + match.matched_literals;
    const Distance distance = distance_of(match.distance);
    const BitString& far = distance_code_[distance.symbol];
    split(match.length, [&](std::uint32_t length, std::uint32_t times) {
      const std::uint8_t code = kLengths.code[length];
      const BitString& near = codes[kFirstLength + code];
      std::uint64_t bits = near.bits;
      std::uint32_t count = near.count;
      bits |= std::uint64_t{length - kLengths.base[code]} << count;
      count += kLengths.extra[code];
      bits |= std::uint64_t{far.bits} << count;
      count += far.count;
      bits |= std::uint64_t{distance.extra} << count;
      count += distance.extra_bits;
      // Long runs: four matches of a few bits each at once.
      if (times >= 4 && count <= 14) {
        std::uint64_t four = bits | bits << count;
        four |= four << 2 * count;
        for (; times >= 4; times -= 4) {
          out.put(four, 4 * count);
          out.flush();
        }
      }
      for (; times > 0; --times) {
        out.put(bits, count);
        out.flush();
      }
    });
  }
  put_literals(rest);
  out.put(codes[kEndOfBlock]);
  out.flush();
}

void RunDeflater::write(std::vector<std::uint8_t>& out) {
  written_ = true;
  find_matches();
  count_symbols();
  std::uint64_t bits = extra_bits_ + literal_code_.make(literal_frequencies_, kCodeLimit) +
                       distance_code_.make(distance_frequencies_, kCodeLimit);
  header_.make(literal_code_, distance_code_);
  bits += header_.bit_count();
  // An empty stored block, whose length starts on a byte, ends the piece.
  const std::size_t start = out.size(), size = (bits + 3 + 7) / 8 + 4;
  out.resize(start + size + 8);
  BitWriter writer(out.data() + start);
  header_.write(writer);
  write_matches(writer);
  writer.put(0, 3);
  std::uint8_t* const end = writer.finish();
  constexpr std::uint8_t empty[4] = {0, 0, 255, 255};
  std::memcpy(end, empty, sizeof empty);
  out.resize(start + size);
}

}  // namespace slicecorr::detail
