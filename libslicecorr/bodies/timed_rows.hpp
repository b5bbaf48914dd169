// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What changes in rows from slice to slice, of what is solid and of when it gels.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "bodies/solid_rows.hpp"
#include "slicecorr/bodies.hpp"

namespace slicecorr::detail {

/// Rows as `BodyTracker` is told of them. For one thread.
class TimedRows {
 public:
  using Run = BodyTracker::Run;
  /// Columns where something changes in a row, in rising order: 2k and 2k + 1 are the ends of run k.
  using Ends = std::vector<int>;
  /// `box`: the rows. `keeps_solid`: `set_row` and `solid` are to be called.
  explicit TimedRows(const PixelBox& box, bool keeps_solid = true)
      : box_(box), keeps_solid_(keeps_solid) {}

  void set_row(int y, std::span<const Run> runs);
  void flip_row(int y, std::span<const Run> runs);
  void set_delays(int y, std::span<const Run> runs);
  /// What is solid in a row, counted from the first; nothing before something was.
  const Ends& solid(int row) const { return solid_[static_cast<std::size_t>(row)]; }
  /// Ends the slice at hand, and `more` after it that are like it. Calls `take(row, changes, flips)` with
  /// each row that changed in it, from the first on; `flips`: whether what is solid in it did.
  template <class Take>
  void end_slice(int more, const Take& take) {
    sort();
    for (std::size_t i = 0, k = 0; i < flipped_rows_.size() || k < timed_.size();) {
      const int row = next_row(i, k);
      std::size_t past = k;
      while (past < timed_.size() && timed_[past].row == row) ++past;
      const bool told = i < flipped_rows_.size() && flipped_rows_[i] == row;
      Ends* const its = told ? &flipped_[static_cast<std::size_t>(row)] : nullptr;
      put_changes(its, std::span<const Timed>(timed_).subspan(k, past - k));
      take(row, std::span<const SolidRows::Change>(changes_), its && !its->empty());
      k = past;
      if (its) its->clear();
      while (i < flipped_rows_.size() && flipped_rows_[i] == row) ++i;
    }
    flipped_rows_.clear();
    timed_.clear();
    slice_ += 1 + more;
  }

 private:
  /// When voxels of a row gel.
  struct Timed {
    int row = 0, begin = 0, end = 0;
    GelTime gels;
  };
  /// Puts the ends of runs into `put_in_`.
  void put_ends(std::span<const Run> runs);
  void flip(int row, const Ends& its);
  void sort();
  int next_row(std::size_t flipped, std::size_t timed) const;
  /// Into `changes_`, where some columns flip (null: none) and others are timed, each from left to right.
  void put_changes(const Ends* flips, std::span<const Timed> timed);

  const PixelBox box_;
  const bool keeps_solid_;
  int slice_ = 0;                      ///< the one at hand
  std::vector<Ends> solid_, flipped_;  ///< by row; `flipped_`: in the slice at hand
  std::vector<int> flipped_rows_;      ///< may stand twice
  std::vector<Timed> timed_;
  std::vector<SolidRows::Change> changes_;
  Ends ends_, put_in_;
};

}  // namespace slicecorr::detail
