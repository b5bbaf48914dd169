// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Bodies of voxels of one kind as they grow, slice by slice: a union-find over the labels of their runs,
/// with sums for each body.
#pragma once

#include <compare>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

namespace slicecorr::detail {

/// In the order of slices, rows and columns.
struct FirstVoxel {
  int slice = std::numeric_limits<int>::max(), y = 0, x = 0;
  auto operator<=>(const FirstVoxel&) const = default;  // NOLINT(modernize-use-nullptr)
};

/// A body as it is known so far.
struct GrowingBody {
  int first = 0;  ///< slice at hand when it begins
  FirstVoxel low;
  bool anchored = false;  ///< hangs on what all hangs on
  bool told = false;      ///< was not anchored at the end of a slice
  int counted = 0;        ///< slices before this one are in the sums
  std::uint64_t voxels = 0;
  __int128 column2 = 0, row2 = 0;  ///< sums of twice the middles of voxels
  /// The same of those that joined it in the slice at hand.
  FirstVoxel joined_low;
  std::uint64_t joined_voxels = 0;
  __int128 joined_column2 = 0, joined_row2 = 0;
  std::uint64_t joined_widest = 0;
  int joined_widest_slice = 0;
  std::uint64_t area = 0;  ///< voxels that a slice adds now
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
  /// Nothing joins the body any more: nothing of it is in this slice, or there is no slice left.
  virtual void end(GrowingBody& body, int slice, bool no_slice_left) = 0;
};

/// No figure depends on the order in which bodies join within a slice. Not thread-safe.
class GrowingBodies {
 public:
  using Label = std::uint32_t;
  static constexpr Label kNone = 0xFFFFFFFF;
  /// Columns [begin, end) of a row.
  struct Patch {
    std::int32_t row = 0, begin = 0, end = 0;
  };
  /// Voxels, with sums of twice their middles.
  struct Volume {
    std::int64_t voxels = 0, column2 = 0, row2 = 0;
    /// Of a patch in so many slices; negative: less of it.
    static Volume of(const Patch& patch, int slices) {
      const std::int64_t begin = patch.begin, end = patch.end;
      return {(end - begin) * slices, (end * end - begin * begin) * slices,
              (end - begin) * (2 * patch.row + 1) * slices};
    }
    Volume& operator+=(const Volume& more) {
      voxels += more.voxels;
      column2 += more.column2;
      row2 += more.row2;
      return *this;
    }
  };
  /// `listener` must outlive this.
  explicit GrowingBodies(BodyListener& listener) : listener_(listener) {}

  /// A body begins in the slice at hand; nothing of it is counted yet. Gives its label.
  Label begin(const FirstVoxel& low, bool anchored);
  /// A body is as low as this, too, from the slice at hand on.
  void lower(Label label, const FirstVoxel& low);
  Label root(Label label) {
    while (parent_[label] != label) {
      parent_[label] = parent_[parent_[label]];
      label = parent_[label];
    }
    return label;
  }
  /// Whether the body hangs on what all hangs on: of such a body no sums are asked for.
  bool anchored(Label label) { return body(root(label)).anchored; }
  /// Labels that are known.
  std::size_t size() const { return parent_.size(); }
  /// Each slice from now on has so many of this patch more of the body, or less.
  void grow(Label label, const Patch& patch, int more);
  /// The body had so much more in slices before the one at hand, or less.
  void add(Label label, const Volume& volume);
  /// Gives the label of both.
  Label unite(Label a, Label b);
  int slice() const { return slice_; }  ///< the one at hand
  /// Ends it. `empty_ends`: bodies without voxels in it end with it, whose labels are used no more.
  void end_slice(bool empty_ends);
  /// Passes slices in which nothing happens.
  void skip(int slices) { slice_ += slices; }

  /// Labels that are used no more make room. `each(keep)` calls keep(label) of all others, which gives them
  /// new ones from 0 on, in the order of the calls. Bodies without a label end.
  template <class Each>
  void renumber(const Each& each) {
    std::vector<Label> to(parent_.size(), kNone);
    std::vector<std::uint32_t> body_of;
    each([&](Label& label) {
      const Label r = root(label);
      if (to[r] == kNone) {
        to[r] = static_cast<Label>(body_of.size());
        body_of.push_back(body_of_[r]);
      }
      label = to[r];
    });
    for (Label label = 0; label < parent_.size(); ++label) {
      if (parent_[label] == label && to[label] == kNone) end(label, false);
    }
    parent_.resize(body_of.size());
    for (std::size_t i = 0; i < parent_.size(); ++i) parent_[i] = static_cast<Label>(i);
    body_of_ = std::move(body_of);
  }
  /// There is no slice any more: all bodies end.
  void finish();

 private:
  static constexpr std::uint32_t kNoBody = 0xFFFFFFFF;
  GrowingBody& body(Label root) { return bodies_[body_of_[root]]; }
  /// Brings the sums up to the slice at hand, in which something changes.
  GrowingBody& change(Label label);
  void count(GrowingBody& body) const;
  void end(Label label, bool no_slice_left);

  BodyListener& listener_;
  int slice_ = 0;
  std::vector<Label> parent_;
  std::vector<std::uint32_t> body_of_;  ///< of labels that are roots; kNoBody: it has ended
  std::vector<GrowingBody> bodies_;
  std::vector<std::uint32_t> free_;  ///< bodies that are none any more
  std::vector<Label> touched_;
};

}  // namespace slicecorr::detail
