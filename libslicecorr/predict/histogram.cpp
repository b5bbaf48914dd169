// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <algorithm>
#include <bit>
#include <cmath>

#include "slicecorr/predict.hpp"

namespace slicecorr {

void Histogram::add(double value) {
  if (low_.empty()) low_.resize((kGreatestExponent - kLeastExponent) * kBinsPerOctave + 1);
  // Exponent and bin come from the bits of the number: frexp, ldexp and llround would take most of
  // a prediction's time.
  const auto bits = std::bit_cast<std::uint64_t>(value);
  const int exponent = static_cast<int>(bits >> 52 & 2047) - 1022;  // of a mantissa in [0.5, 1)
  std::size_t bin = 0;
  if (value > 0 && exponent > kLeastExponent) {
    const int octave = std::min(exponent, kGreatestExponent) - kLeastExponent - 1;
    bin = static_cast<std::size_t>(octave) * kBinsPerOctave + (bits >> 42 & 1023) + 1;
  }
  if (++low_[bin] == 0) carry(bin, 1);
  ++count_;
  const double scaled = value * 1048576.0;
  if (scaled < 4e15) {
    const auto whole = static_cast<std::int64_t>(scaled);
    sum_ += static_cast<unsigned __int128>(whole + (scaled - static_cast<double>(whole) >= 0.5));
  } else {
    sum_ += static_cast<unsigned __int128>(std::llround(scaled));
  }
  least_ = std::min(least_, value);
  greatest_ = std::max(greatest_, value);
}

void Histogram::carry(std::size_t bin, std::uint64_t times) {
  if (high_.empty()) high_.resize(low_.size());
  high_[bin] += times;
}

void Histogram::merge(const Histogram& other) {
  if (other.low_.empty()) return;
  if (low_.empty()) low_.resize(other.low_.size());
  for (std::size_t i = 0; i < low_.size(); ++i) {
    const std::uint64_t sum = std::uint64_t{low_[i]} + other.in_bin(i);
    low_[i] = static_cast<std::uint16_t>(sum);
    if (sum >> 16) carry(i, sum >> 16);
  }
  count_ += other.count_;
  sum_ += other.sum_;
  least_ = std::min(least_, other.least_);
  greatest_ = std::max(greatest_, other.greatest_);
}

double Histogram::mean() const {
  if (count_ == 0) return 0;
  return std::ldexp(static_cast<double>(sum_), -20) / static_cast<double>(count_);
}

double Histogram::quantile(double q) const {
  if (count_ == 0) return 0;
  const auto rank =
      static_cast<std::uint64_t>(std::max(1.0, std::ceil(q * static_cast<double>(count_) - 1e-9)));
  std::uint64_t seen = 0;
  std::size_t bin = 0;
  for (; bin < low_.size(); ++bin) {
    seen += in_bin(bin);
    if (seen >= rank) break;
  }
  return middle_of(bin);
}

double Histogram::middle_of(std::size_t bin) const {
  double value = 0;
  if (bin > 0) {
    const auto octave = static_cast<int>((bin - 1) / kBinsPerOctave);
    const double mantissa = static_cast<double>((bin - 1) % kBinsPerOctave) + 0.5;
    value = std::ldexp(0.5 + mantissa / (2.0 * kBinsPerOctave), octave + kLeastExponent + 1);
  }
  return std::clamp(value, least_, greatest_);
}

std::vector<std::uint64_t> Histogram::coarse(const std::vector<double>& edges) const {
  std::vector<std::uint64_t> counts(edges.size() > 1 ? edges.size() - 1 : 0, 0);
  if (counts.empty()) return counts;
  std::size_t at = 0;
  for (std::size_t bin = 0; bin < low_.size(); ++bin) {
    if (in_bin(bin) == 0) continue;
    const double value = middle_of(bin);
    while (at + 1 < counts.size() && value >= edges[at + 1]) ++at;
    counts[at] += in_bin(bin);
  }
  return counts;
}

}  // namespace slicecorr
