// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Bodies of what is not solid, joined by faces: runs of two neighbouring slices.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "bodies/growing_bodies.hpp"
#include "bodies/neighbour_rows.hpp"
#include "slicecorr/bodies.hpp"

namespace slicecorr::detail {

class JoinedRows {
 public:
  using Run = BodyTracker::Run;
  /// Bodies hang on what lies beside the rows and their columns [first, past). `listener` must outlive
  /// this.
  JoinedRows(int rows, int first, int past, BodyListener& listener);

  void set_row(int y, std::span<const Run> runs);
  void end_slice(int more);
  void finish();

 private:
  using Label = GrowingBodies::Label;
  struct Labelled {
    std::int32_t begin = 0, end = 0;
    Label label = 0;
  };
  using Row = std::vector<Labelled>;
  static constexpr Label kNone = GrowingBodies::kNone, kAnchor = 0;

  void leave(const Labelled& run, int row) {
    bodies_.grow(run.label, {row, run.begin, run.end}, -1);
  }
  void enter(const Labelled& run, int row) {
    bodies_.grow(run.label, {row, run.begin, run.end}, 1);
  }
  void join_rows(int upper, int lower);
  void renumber();

  const int first_, past_;
  GrowingBodies bodies_;
  std::vector<Row> rows_;
  Row next_;
  ChangedRows changed_;
  std::size_t runs_ = 0;
};

}  // namespace slicecorr::detail
