// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// The preview picture of a stack: the part seen from the window, lit from one side.
#pragma once

#include <cstddef>
#include <cstdint>
#include <mutex>
#include <vector>

#include "slicecorr/stack.hpp"

namespace slicecorr::detail {

/// What the columns of a band show from the first slice to the last: when each was lit last, and
/// the sum of all values. One object for one thread.
class LitColumns {
 public:
  explicit LitColumns(std::size_t columns);
  /// Slices come in rising order, each at most once; null is black.
  void add(int slice, const std::uint8_t* rows);
  std::uint64_t sum() const { return sum_; }
  /// The last lit slice + 1 of each column, 0: never lit. To be called once, after all slices.
  const std::vector<std::int32_t>& finish();

 private:
  /// Columns whose bits are set were lit until slice `next_` - 1.
  void end(std::size_t word, std::uint64_t bits);

  std::size_t columns_;
  int next_ = 0;                         ///< one after the last slice with light
  bool lit_ = false;                     ///< any bit of `lit_now_`
  std::vector<std::uint64_t> lit_now_;   ///< a bit per column
  std::vector<std::uint64_t> lit_next_;  ///< those of the slice at hand
  std::vector<std::int32_t> last_lit_;
  std::uint64_t sum_ = 0;
};

/// Collects the last lit slice of every pixel, reduced to a small picture. Thread-safe; the order
/// of bands does not matter.
class Relief {
 public:
  Relief(const PixelBox& bounds, int layers);
  /// Takes the last lit slices + 1 (0: never lit) of a band's columns.
  void add(const PixelBox& band, const std::vector<std::int32_t>& last_lit);
  GreyImage picture() const;
  bool empty() const;

 private:
  PixelBox bounds_;
  int layers_, step_, width_, height_;
  std::vector<std::int32_t> depth_;
  std::mutex mutex_;
};

}  // namespace slicecorr::detail
