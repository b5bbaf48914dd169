// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Bodies of voxels, as they grow; and those of what is not solid, joined by faces, slice by slice: runs
/// of two neighbouring slices, and a union-find over their labels.
#pragma once

#include <compare>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "slicecorr/bodies.hpp"

namespace slicecorr::detail {

/// In the order of slices, rows and columns.
struct FirstVoxel {
  int slice = std::numeric_limits<int>::max(), y = 0, x = 0;
  auto operator<=>(const FirstVoxel&) const = default;
};

/// A body as it is known so far.
struct GrowingBody {
  int first = 0;          ///< slice at hand when it begins
  int x = 0, y = 0;       ///< its first pixel there
  bool anchored = false;  ///< hangs on what all hangs on
  bool told = false;      ///< was not anchored at the end of a slice
  int counted = 0;        ///< slices before this one are in the sums
  std::uint64_t voxels = 0;
  __int128 column2 = 0, row2 = 0;  ///< sums of twice the middles of voxels
  FirstVoxel low;                  ///< of what is solid
  /// The same of those that joined it in the slice at hand.
  std::uint64_t joined_voxels = 0;
  __int128 joined_column2 = 0, joined_row2 = 0;
  FirstVoxel joined_low;
  std::uint64_t joined_widest = 0;
  int joined_widest_slice = 0;
  std::uint64_t area = 0;  ///< voxels in the slice at hand
  std::int64_t area_column2 = 0, area_row2 = 0;
  std::uint64_t widest = 0;  ///< greatest `area`, in slice `widest_slice`
  int widest_slice = 0;
  int touched = -1;               ///< the last slice in which `area` changed
  std::int32_t waiting = -1;      ///< for the listener
  std::int32_t waiting_end = -1;  ///< for the listener
};

/// Told of what becomes of bodies.
class BodyListener {
 public:
  virtual ~BodyListener() = default;
  /// `younger` joins `older` in a slice; their sums are what each had before it.
  virtual void join(GrowingBody& older, GrowingBody& younger, int slice) = 0;
  /// A slice in which the body changed is done.
  virtual void end_slice(GrowingBody& body) = 0;
  /// Nothing of the body is in this slice, or there is no slice any more.
  virtual void end(GrowingBody& body, int slice, bool no_slice_left) = 0;
};

class JoinedRows {
 public:
  using Label = std::uint32_t;
  using Run = BodyTracker::Run;
  /// Bodies hang on what lies beside the rows and their columns [first, past). `listener` must outlive
  /// this.
  JoinedRows(int rows, int first, int past, BodyListener& listener);

  void set_row(int row, std::span<const Run> runs);
  void end_slice(int more);
  void finish();

 private:
  struct Labelled {
    std::int32_t begin = 0, end = 0;
    Label label = 0;
  };
  using Row = std::vector<Labelled>;
  static constexpr Label kNone = 0xFFFFFFFF, kAnchor = 0;

  Label root(Label label);
  GrowingBody& body(Label root) { return bodies_[body_of_[root]]; }
  Label unite(Label a, Label b);
  Label add_body(int row, int column);
  /// Brings the sums up to the slice at hand, in which the area changes.
  GrowingBody& change(Label label);
  void count(GrowingBody& body) const;
  void leave(const Labelled& run, int row);
  void enter(const Labelled& run, int row);
  void join_rows(int a, int b);
  void renumber();
  bool older(const GrowingBody& a, const GrowingBody& b) const;

  const int first_, past_;
  BodyListener& listener_;
  int slice_ = 0;
  std::vector<Row> rows_;
  Row next_;
  std::vector<std::uint8_t> changed_;  ///< per row
  std::vector<int> changed_rows_;
  std::size_t runs_ = 0;
  std::vector<Label> parent_;
  std::vector<std::uint32_t> body_of_;  ///< of labels that are roots
  std::vector<GrowingBody> bodies_;
  std::vector<std::uint32_t> free_;  ///< bodies that are none any more
  std::vector<Label> touched_;
};

}  // namespace slicecorr::detail
