// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Bodies of what is solid, joined by faces, in space and in time: voxels gel in their own slice or some
/// slices after it. Rows are given slice by slice; a union-find over their runs takes them in the order
/// in which they gel.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "bodies/joined_rows.hpp"

namespace slicecorr::detail {

class SolidRows {
 public:
  using Label = std::uint32_t;
  using Run = BodyTracker::Run;
  /// Bodies hang on what comes before slice 0. `listener` must outlive this; slices that it is told are
  /// those at hand when something happens.
  SolidRows(int rows, BodyListener& listener);

  /// Runs from left to right; neighbours that touch gel at different times.
  void set_row(int row, std::span<const Run> runs);
  /// Whether the slice at hand has anything of them.
  bool any() const { return runs_ > 0; }
  void end_slice(int more);
  void finish();

 private:
  /// Of a run as long as its row does not change. Voxels of its columns in the slices between gel one
  /// after the other, and hang on each other.
  struct Labelled {
    std::int32_t begin = 0, end = 0, delay = 0;
    Label label = 0;
    bool same(const Run& r) const { return begin == r.begin && end == r.end && delay == r.delay; }
  };
  using Row = std::vector<Labelled>;
  /// What happens when the slice of a bucket is at hand.
  struct Change {  ///< a run begins to gel, or has gelled
    Label label;
    std::int32_t row, begin, end;
  };
  struct Edge {
    Label a, b;
  };
  struct Bucket {
    std::vector<Change> begins, ends;
    std::vector<Edge> edges;
    bool empty() const { return begins.empty() && ends.empty() && edges.empty(); }
  };
  static constexpr Label kNone = 0xFFFFFFFF;

  Label root(Label label);
  GrowingBody& body(Label root) { return bodies_[body_of_[root]]; }
  Label add_body(int row, const Run& run);
  Bucket& at(int slice);
  /// Two runs that share a face gel both in `slice` at the latest.
  void join(const Labelled& a, const Labelled& b, int slice);
  void join_rows(int upper, int lower);
  void unite(Label a, Label b);
  GrowingBody& change(Label label);
  void count(GrowingBody& body) const;
  void grow(const Change& run, int sign);
  /// All that happens while the slice at hand is there.
  void pass_slice();
  void renumber();
  bool older(const GrowingBody& a, const GrowingBody& b) const;

  BodyListener& listener_;
  int slice_ = 0;  ///< the one at hand
  std::vector<Row> rows_;
  Row next_;
  std::vector<std::uint8_t> changed_;  ///< per row
  std::vector<int> changed_rows_;
  std::size_t runs_ = 0;
  std::vector<Bucket> buckets_;  ///< of slices from the one at hand on, a power of two of them
  std::size_t waiting_ = 0;      ///< in buckets
  std::vector<Label> parent_;
  std::vector<std::uint32_t> body_of_;  ///< of labels that are roots
  std::vector<GrowingBody> bodies_;
  std::vector<std::uint32_t> free_;  ///< bodies that are none any more
  std::vector<Label> touched_;
};

}  // namespace slicecorr::detail
