#include "stack/run_deflate.hpp"

#if defined(__SSE2__)
#include <emmintrin.h>
#endif

#include <algorithm>
#include <bit>
#include <cstring>

namespace slicecorr::detail {
namespace {

constexpr std::uint32_t no_value = 256;
constexpr std::uint32_t least_match = 3, longest_match = 258, farthest = 32768;
/// No code is longer, so that four literals, or a whole reference, fit between two flushes.
constexpr unsigned code_limit = 12;

/// Length symbols: code, number of extra bits and least length of each.
struct LengthTable {
  std::array<std::uint8_t, longest_match + 1> code{};
  std::array<std::uint8_t, 29> extra{};
  std::array<std::uint16_t, 29> base{};
  constexpr LengthTable() {
    unsigned length = least_match;
    for (unsigned c = 0; c < 28; ++c) {
      extra[c] = static_cast<std::uint8_t>(c < 8 ? 0 : c / 4 - 1);
      base[c] = static_cast<std::uint16_t>(length);
      for (unsigned i = 0; i < 1u << extra[c] && length < longest_match; ++i) {
        code[length++] = static_cast<std::uint8_t>(c);
      }
    }
    code[longest_match] = 28;
    base[28] = longest_match;
  }
};
constexpr LengthTable lengths;

struct Distance {
  std::uint32_t symbol, extra_bits, extra;
};
Distance distance_of(std::uint32_t distance) {
  const std::uint32_t d = distance - 1;
  if (d < 4) return {d, 0, 0};
  const auto bits = static_cast<std::uint32_t>(std::bit_width(d)) - 2;
  return {2 * bits + 2 + (d >> bits & 1), bits, d & ((1u << bits) - 1)};
}

/// Calls `take(length, times)` for references that together have this length.
template <class Take>
void split(std::uint32_t length, const Take& take) {
  if (length <= longest_match) {
    take(length, 1u);
    return;
  }
  const std::uint32_t times = length / longest_match, rest = length % longest_match;
  if (rest == 0 || rest >= least_match) {
    take(longest_match, times);
    if (rest != 0) take(rest, 1u);
  } else {
    if (times > 1) take(longest_match, times - 1);
    take(longest_match + rest - least_match, 1u);
    take(least_match, 1u);
  }
}

constexpr std::size_t block = 64;

/// Bit i: whether p[i] differs from p[i - 1].
std::uint64_t changes(const std::uint8_t* p) {
  std::uint64_t equal = 0;
#if defined(__SSE2__)
  for (int i = 0; i < 4; ++i) {
    const auto a = _mm_loadu_si128(reinterpret_cast<const __m128i*>(p + 16 * i));
    const auto b = _mm_loadu_si128(reinterpret_cast<const __m128i*>(p + 16 * i - 1));
    const int mask = _mm_movemask_epi8(_mm_cmpeq_epi8(a, b));
    equal |= static_cast<std::uint64_t>(static_cast<unsigned>(mask)) << (16 * i);
  }
#else
  for (unsigned i = 0; i < block; ++i) {
    equal |= static_cast<std::uint64_t>(p[i] == p[static_cast<std::ptrdiff_t>(i) - 1]) << i;
  }
#endif
  return ~equal;
}

/// Up to eight literals as a number; there are eight readable bytes.
std::uint64_t load(const std::uint8_t* p, std::uint32_t count) {
  std::uint64_t v;
  std::memcpy(&v, p, 8);
  return count >= 8 ? v : v & ((std::uint64_t{1} << 8 * count) - 1);
}

constexpr unsigned hash_bits = 11;

}  // namespace

void RunDeflater::clear() {
  literal_count_ = step_count_ = step_start_ = run_ = 0;
  value_ = no_value;
}

/// For `n` more bytes, whatever they are, and what is written beyond the last.
void RunDeflater::make_room(std::size_t n) {
  if (literals_.size() < literal_count_ + n + block + 8) {
    literals_.resize(2 * (literal_count_ + n + block));
  }
  if (steps_.size() < step_count_ + n / 4 + 4) steps_.resize(2 * (step_count_ + n / 4 + 4));
}

void RunDeflater::end_run() {
  if (run_ >= least_match) {
    steps_[step_count_++] = {static_cast<std::uint32_t>(literal_count_ - step_start_),
                             static_cast<std::uint32_t>(run_)};
    step_start_ = literal_count_;
  } else {
    literals_[literal_count_] = literals_[literal_count_ + 1] = static_cast<std::uint8_t>(value_);
    literal_count_ += run_;
  }
  run_ = 0;
}

void RunDeflater::start_run(std::uint8_t value) {
  value_ = value;
  literals_[literal_count_++] = value;
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
  // More changes in a block than this, and it is cheaper to take all of it as it is.
  constexpr int dense = 28;
  std::size_t i = 1;
  for (; i + block <= n; i += block) {
    std::uint64_t starts = changes(bytes + i);
    if (starts == 0) {
      run_ += block;
      continue;
    }
    if (std::popcount(starts) >= dense) {
      end_run();
      std::memcpy(&literals_[literal_count_], bytes + i, block);
      literal_count_ += block;
      value_ = bytes[i + block - 1];
      continue;
    }
    std::size_t from = 0;
    do {
      const auto to = static_cast<std::size_t>(std::countr_zero(starts));
      starts &= starts - 1;
      run_ += to - from;
      end_run();
      start_run(bytes[i + to]);
      from = to + 1;
    } while (starts != 0);
    run_ += block - from;
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

bool RunDeflater::only_zeros() const {
  return value_ == no_value || (step_count_ == 0 && literal_count_ == 1 && value_ == 0);
}

std::size_t RunDeflater::refer(std::size_t at, std::size_t before) {
  const std::uint32_t distance = places_[at].raw - places_[before].raw;
  if (distance > farthest) return 0;
  std::uint32_t covered = 0, length = 0, steps = 0;
  for (; at + steps < step_count_; ++steps) {
    const Step& step = steps_[at + steps];
    if (step != steps_[before + steps] || length + step.literals > longest_match) break;
    const std::uint8_t* const a = &literals_[places_[at + steps].literal];
    const std::uint8_t* const b = &literals_[places_[before + steps].literal];
    if (load(a, step.literals) != load(b, step.literals)) break;
    if (step.literals > 8 && std::memcmp(a, b, step.literals) != 0) break;
    covered += step.literals;
    length += step.literals + step.run;
    if (length >= longest_match) {
      ++steps;
      break;
    }
  }
  // A reference takes about as many bits as two or three literals and a run.
  if (steps == 0 || (steps == 1 && covered < 3)) return 0;
  // What is left of the last run is a run still.
  std::uint32_t rest = length > longest_match ? length - longest_match : 0;
  if (rest != 0 && rest < least_match) rest = least_match;
  orders_.push_back({0, covered, length - rest, distance});
  if (rest != 0) orders_.push_back({0, 0, rest, 1});
  return steps;
}

void RunDeflater::find_orders() {
  orders_.clear();
  if (places_.size() < step_count_) places_.resize(steps_.size());
  if (seen_.empty()) seen_.resize(std::size_t{1} << hash_bits);
  if (first_id_ > 0x7fffffffu) {
    std::fill(seen_.begin(), seen_.end(), 0u);
    first_id_ = 1;
  }
  std::uint32_t raw = 0, literal = 0;
  for (std::size_t i = 0; i < step_count_; ++i) {
    places_[i] = {raw, literal};
    raw += steps_[i].literals + steps_[i].run;
    literal += steps_[i].literals;
  }
  for (std::size_t i = 0; i < step_count_;) {
    const Step& step = steps_[i];
    std::uint64_t h = load(&literals_[places_[i].literal], step.literals);
    h = (h ^ std::uint64_t{step.run} << 40 ^ std::uint64_t{step.literals} << 24) *
        0x9e3779b97f4a7c15u;
    std::uint32_t& seen = seen_[h >> (64 - hash_bits)];
    const std::uint32_t before = seen;
    seen = first_id_ + static_cast<std::uint32_t>(i);
    const std::size_t steps = before < first_id_ ? 0 : refer(i, before - first_id_);
    if (steps == 0) orders_.push_back({step.literals, 0, step.run, 1});
    i += std::max<std::size_t>(steps, 1);
  }
  first_id_ += static_cast<std::uint32_t>(step_count_);
}

void RunDeflater::count_symbols() {
  literal_frequencies_.fill(0);
  distance_frequencies_.fill(0);
  extra_bits_ = 0;
  std::array<std::uint32_t, 256> odd{};
  const std::uint8_t* literal = literals_.data();
  // Two tables: counting equal bytes in a row in one would wait for itself.
  const auto count = [&](std::size_t n) {
    for (; n >= 2; n -= 2, literal += 2) {
      ++literal_frequencies_[literal[0]];
      ++odd[literal[1]];
    }
    if (n != 0) ++literal_frequencies_[*literal++];
  };
  std::size_t rest = literal_count_;
  for (const Order& order : orders_) {
    count(order.literals);
    literal += order.covered;
    rest -= order.literals + order.covered;
    const Distance distance = distance_of(order.distance);
    split(order.length, [&](std::uint32_t length, std::uint32_t times) {
      const std::uint8_t code = lengths.code[length];
      literal_frequencies_[first_length + code] += times;
      distance_frequencies_[distance.symbol] += times;
      extra_bits_ += std::uint64_t{times} * (lengths.extra[code] + distance.extra_bits);
    });
  }
  count(rest);
  for (std::size_t i = 0; i < odd.size(); ++i) literal_frequencies_[i] += odd[i];
  literal_frequencies_[end_of_block] = 1;
}

void RunDeflater::write(BitWriter& out) const {
  const std::uint8_t* literal = literals_.data();
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
  std::size_t rest = literal_count_;
  for (const Order& order : orders_) {
    put_literals(order.literals);
    literal += order.covered;
    rest -= order.literals + order.covered;
    const Distance distance = distance_of(order.distance);
    const BitString& far = distance_code_[distance.symbol];
    split(order.length, [&](std::uint32_t length, std::uint32_t times) {
      const std::uint8_t code = lengths.code[length];
      const BitString& near = codes[first_length + code];
      std::uint64_t bits = near.bits;
      std::uint32_t count = near.count;
      bits |= std::uint64_t{length - lengths.base[code]} << count;
      count += lengths.extra[code];
      bits |= std::uint64_t{far.bits} << count;
      count += far.count;
      bits |= std::uint64_t{distance.extra} << count;
      count += distance.extra_bits;
      // Long runs: four references of some bits each at once.
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
  out.put(codes[end_of_block]);
  out.flush();
}

void RunDeflater::finish(std::vector<std::uint8_t>& out) {
  make_room(4);
  if (value_ != no_value) end_run();
  find_orders();
  count_symbols();
  make_code(literal_frequencies_, code_limit, literal_code_);
  make_code(distance_frequencies_, code_limit, distance_code_);
  header_.make(literal_code_, distance_code_);
  std::uint64_t bits = header_.bit_count() + extra_bits_;
  for (std::size_t i = 0; i < literal_symbols; ++i) {
    bits += std::uint64_t{literal_frequencies_[i]} * literal_code_[i].count;
  }
  for (std::size_t i = 0; i < distance_symbols; ++i) {
    bits += std::uint64_t{distance_frequencies_[i]} * distance_code_[i].count;
  }
  // An empty stored block, whose length starts on a byte, ends the piece.
  const std::size_t start = out.size(), size = (bits + 3 + 7) / 8 + 4;
  out.resize(start + size + 8);
  BitWriter writer(out.data() + start);
  header_.write(writer);
  write(writer);
  writer.put(0, 3);
  std::uint8_t* const end = writer.finish();
  constexpr std::uint8_t empty[4] = {0, 0, 255, 255};
  std::memcpy(end, empty, sizeof empty);
  out.resize(start + size);
}

}  // namespace slicecorr::detail
