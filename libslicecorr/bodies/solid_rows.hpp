// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Bodies of what is solid, joined by faces, in space and in time: voxels gel in their own slice or some
/// slices after it. Rows are given slice by slice, and join in the order in which they gel.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "bodies/growing_bodies.hpp"
#include "bodies/neighbour_rows.hpp"
#include "slicecorr/bodies.hpp"

namespace slicecorr::detail {

class SolidRows {
 public:
  using Run = BodyTracker::Run;
  /// Bodies hang on what comes before slice 0. `listener` must outlive this; slices that it is told are
  /// those at hand when something happens.
  SolidRows(int rows, BodyListener& listener);

  /// Runs from left to right; neighbours that touch gel at different times.
  void set_row(int y, std::span<const Run> runs);
  /// Whether the slice at hand has anything of them.
  bool any() const { return runs_ > 0; }
  void end_slice(int more);
  void finish();

 private:
  using Label = GrowingBodies::Label;
  /// Of a run as long as its row does not change. Voxels of its columns in the slices between gel one
  /// after the other, and hang on each other.
  struct Labelled {
    std::int32_t begin = 0, end = 0, delay = 0;
    Label label = 0;
    bool same(const Run& r) const { return begin == r.begin && end == r.end && delay == r.delay; }
  };
  using Row = std::vector<Labelled>;
  struct Change {
    Label label;
    GrowingBodies::Patch patch;
  };
  struct Beginning : Change {
    int slice;  ///< that of the patch's first voxels
  };
  struct Edge {
    Label a, b;
  };
  /// What happens in a slice.
  struct Bucket {
    std::vector<Beginning> begins;  ///< runs that begin to gel, each a body of its own
    std::vector<Change> goes_on;    ///< runs that begin to gel, on what has gelled below them
    std::vector<Change> ends;       ///< runs of which all has gelled
    std::vector<Edge> edges;        ///< of runs that share a face, which have both gelled now
    std::size_t size() const { return begins.size() + goes_on.size() + ends.size() + edges.size(); }
  };

  int slice() const { return bodies_.slice(); }
  Bucket& at(int n);
  /// Two runs that share a face have both gelled in `slice`.
  void join(const Labelled& a, const Labelled& b, int n);
  /// All that happens while the slice at hand is there.
  void pass_slice();
  void renumber();

  GrowingBodies bodies_;
  std::vector<Row> rows_;
  Row next_;
  ChangedRows changed_;
  std::size_t runs_ = 0;
  std::vector<Bucket> buckets_;  ///< of slices from the one at hand on, a power of two of them
  std::size_t waiting_ = 0;      ///< in buckets
};

}  // namespace slicecorr::detail
