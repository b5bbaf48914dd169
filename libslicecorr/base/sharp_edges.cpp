// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "base/sharp_edges.hpp"

#include <algorithm>
#include <bit>
#include <cstdlib>
#include <utility>

#include "base/row_kernels.hpp"

namespace slicecorr::detail {

SharpEdges::SharpEdges(const CodedBand& heights, Sink sink, bool sharpen)
    : heights_(heights),
      sink_(std::move(sink)),
      sharpen_(sharpen),
      columns_(heights.columns()),
      words_((columns_ + kRowWord - 1) / kRowWord),
      kept_(words_ * kRowWord) {
  for (Row& r : rows_) {
    r.coverage.assign(words_ * kRowWord, 0);
    r.greys.assign(words_, 0);
    r.height_at.assign(words_ * kRowWord, 0);
  }
}

void SharpEdges::add(const std::uint8_t* rows) {
  take(rows);
  if (taken_ - given_ > kLongestRun) give(given_++);
}

void SharpEdges::finish() {
  const int slices = taken_;
  while (given_ < slices) {
    take(nullptr);
    give(given_++);
  }
  if (taken_ == slices) take(nullptr);
  give(slices);
}

/// Makes slice `taken_` the newest one, and resolves the runs that it ends.
void SharpEdges::take(const std::uint8_t* rows) {
  Row& r = row(taken_);
  r.grey = false;
  if (rows != nullptr && !all_zero(rows, columns_)) {
    r.black = false;
    const std::size_t whole = columns_ / kRowWord;
    std::uint8_t* const coverage = r.coverage.data();
    r.grey = copy_and_find_greys(rows, whole, coverage, r.greys.data());
    if (whole < words_) {
      std::uint8_t* const rest = coverage + whole * kRowWord;
      std::copy_n(rows + whole * kRowWord, columns_ % kRowWord, rest);
      r.grey |= copy_and_find_greys(rest, 1, rest, r.greys.data() + whole);
    }
  } else if (!r.black) {
    std::fill(r.coverage.begin(), r.coverage.end(), std::uint8_t{0});
    r.black = true;
  }
  for (const NonZero& height : r.heights) r.height_at[height.at] = 0;
  heights_.read_nonzero(taken_, r.heights);
  for (const NonZero& height : r.heights) r.height_at[height.at] = height.value;
  ++taken_;
  end_runs();
}

/// Resolves the runs of which the newest slice but one is the last.
void SharpEdges::end_runs() {
  const int newest = taken_ - 1;
  const Row &after = row(newest), &last = row(newest - 1);
  if (!sharpen_ || newest == 0 || !last.grey) return;
  bool any_height = false;
  for (int n = newest - kLongestRun; n <= newest; ++n) any_height |= !row(n).heights.empty();
  if (!any_height) return;
  for (std::size_t w = 0; w < words_; ++w) {
    std::uint64_t ends = last.greys[w] & ~(after.grey ? after.greys[w] : 0);
    for (; ends != 0; ends &= ends - 1) {
      resolve(w * kRowWord + static_cast<std::size_t>(std::countr_zero(ends)));
    }
  }
}

void SharpEdges::resolve(std::size_t column) {
  const int past = taken_ - 1;
  const auto is_grey = [&](int n) {
    const Row& r = row(n);
    return r.grey && (r.greys[column / kRowWord] >> (column % kRowWord) & 1) != 0;
  };
  int first = past - 1;
  while (past - first <= kLongestRun && is_grey(first - 1)) --first;
  if (past - first > kLongestRun) return;
  const std::uint8_t before = row(first - 1).coverage[column], after = row(past).coverage[column];
  if (before == after) return;
  int edge = -1;
  for (int node = first; node <= past; ++node) {
    if (row(node).height_at[column] == 0) continue;
    if (edge >= 0) return;
    edge = node;
  }
  if (edge < 0) return;
  for (int n = first; n < past; ++n) row(n).coverage[column] = n < edge ? before : after;
}

void SharpEdges::give(int n) {
  const Row &over = row(n - 1), &r = row(n);
  bool kept = false;
  for (const NonZero& height : r.heights) {
    // Of two bytes a difference of 255 is that of 0 and 255 alone.
    if (std::abs(over.coverage[height.at] - r.coverage[height.at]) != 255) continue;
    kept_[height.at] = height.value;
    kept = true;
  }
  sink_(n, r.black ? nullptr : r.coverage.data(), kept ? kept_.data() : nullptr);
  for (const NonZero& height : r.heights) kept_[height.at] = 0;
}

}  // namespace slicecorr::detail
