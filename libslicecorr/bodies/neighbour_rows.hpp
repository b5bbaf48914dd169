// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Rows of runs that lie beside each other.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace slicecorr::detail {

/// Takes each two runs of two rows that have columns in common, from left to right.
template <class Row, class OtherRow, class Take>
void each_overlap(Row& a, OtherRow& b, const Take& take) {
  for (std::size_t i = 0, j = 0; i < a.size() && j < b.size();) {
    auto& u = a[i];
    auto& v = b[j];
    if (u.begin < v.end && v.begin < u.end) take(u, v);
    if (u.end < v.end) {
      ++i;
    } else {
      ++j;
    }
  }
}

/// Rows that changed in the slice at hand.
class ChangedRows {
 public:
  explicit ChangedRows(int rows) : changed_(static_cast<std::size_t>(rows), 0) {}
  void add(int row) {
    std::uint8_t& changed = changed_[static_cast<std::size_t>(row)];
    if (changed == 0) rows_.push_back(row);
    changed = 1;
  }
  /// Takes each two neighbouring rows of which one changed, from the top down; then none is changed.
  template <class Take>
  void take_neighbours(const Take& take) {
    std::sort(rows_.begin(), rows_.end());
    for (const int y : rows_) {
      if (y > 0) take(y - 1, y);
      const auto below = static_cast<std::size_t>(y) + 1;
      if (below < changed_.size() && changed_[below] == 0) take(y, y + 1);
    }
    for (const int y : rows_) changed_[static_cast<std::size_t>(y)] = 0;
    rows_.clear();
  }

 private:
  std::vector<std::uint8_t> changed_;  ///< per row
  std::vector<int> rows_;
};

}  // namespace slicecorr::detail
