// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Which voxels are solid, kept band by band, as bands are worked on, until they are followed slice by
/// slice. What is kept are changes from slice to slice, coded.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "slicecorr/bodies.hpp"
#include "stack/blob_store.hpp"

namespace slicecorr::detail {

/// The changes of a band, of up to three kinds of solid voxels at once: bits 1, 2 and 4. For one thread.
class VoxelChanges {
 public:
  static constexpr unsigned kKinds = 3;
  explicit VoxelChanges(std::size_t columns) : columns_(columns) {}
  /// From this slice on the column is otherwise; in any order, twice is not at all.
  void flip(int slice, std::size_t column, unsigned kinds = 1) {
    flips_.push_back(
        {static_cast<std::uint32_t>(slice) << kKinds | kinds, static_cast<std::uint32_t>(column)});
    sorted_ = false;
  }
  /// A slice, in rising order: solid where a byte is at least 128; null: nowhere.
  void add_slice(int slice, const std::uint8_t* rows);
  /// The changes of a kind in slices before `layers`, coded; of equal changes the same code.
  std::vector<std::uint8_t> code(int layers, unsigned kind = 1);

 private:
  struct Flip {
    std::uint32_t slice_and_kinds, column;
    std::uint32_t slice() const { return slice_and_kinds >> kKinds; }
    unsigned kinds() const { return slice_and_kinds & ((1U << kKinds) - 1); }
    bool same_place(const Flip& o) const { return column == o.column && slice() == o.slice(); }
  };
  /// By slice, then by column, each place once.
  void sort();
  std::size_t columns_;
  std::vector<Flip> flips_;
  bool sorted_ = true;
  unsigned kinds_ = 0;                 ///< that change anywhere; once sorted
  std::vector<std::uint64_t> before_;  ///< bits of the slice added last; empty: none
};

/// When the voxels of a band gel, where it changes along its columns. For one thread.
class MomentChanges {
 public:
  /// From this slice on; each place once. `at_once`: see BodyTracker::Run.
  void add(int slice, std::size_t column, int delay, bool at_once) {
    const auto value = static_cast<std::uint32_t>(2 * delay + (at_once ? 1 : 0));
    changes_.push_back(
        {static_cast<std::uint32_t>(slice) << kBits | value, static_cast<std::uint32_t>(column)});
    lowest_ = std::min(lowest_, slice);
  }
  /// Whether there are so many that those of slices that are complete should be coded.
  bool many() const { return changes_.size() >= most_; }
  /// The changes in slices before `layers`, coded as those of voxels, each group with its value. Those of
  /// slices before `from` are kept for later.
  std::vector<std::uint8_t> code(int layers, int from = 0);
  /// The same of slices `apart` or more above the lowest so far.
  std::vector<std::uint8_t> code_above(int layers, int apart) {
    return code(layers, lowest_ + apart);
  }

 private:
  static constexpr unsigned kBits = 11;
  static_assert(2 * BodyTracker::kLongestDelay + 1 < 1 << kBits);
  struct Change {
    std::uint32_t slice_and_value, column;
    std::uint32_t slice() const { return slice_and_value >> kBits; }
    std::uint32_t value() const { return slice_and_value & ((1U << kBits) - 1); }
  };
  static constexpr std::size_t kMany = 100000;
  std::vector<Change> changes_;
  int lowest_ = std::numeric_limits<int>::max();
  std::size_t most_ = kMany;
};

class SolidListener;

/// Takes codes of bands, which lie below each other, on any thread. What is more than some memory waits in a file without a name in
/// the folder for temporary files.
class KeptVoxels {
 public:
  /// Changes of one kind, band by band.
  using Pieces = std::vector<BlobStore::Blob>;
  using Stream = std::vector<Pieces>;

  KeptVoxels(std::vector<PixelBox> bands, int layers, const ExecutionContext& context);
  std::size_t bands() const { return bands_.size(); }
  /// `valued`: of moments.
  Pieces keep(const std::vector<std::uint8_t>& code, bool valued = false);
  struct Followed {
    const Stream& changes;
    const Stream* more = nullptr;     ///< changes beside these: what changes twice does not
    const Stream* moments = nullptr;  ///< null: all gels in its own slice
  };
  /// What the slices hold whose changes these are. Throws `Cancelled`.
  Bodies follow(const Followed& what, const Grid& grid, const ImageFrame& frame,
                const BodyAsk& ask) const;

 private:
  class Reader;
  class SliceReader;
  void follow_solids(const Followed& what, const PixelBox& box, int step,
                     SolidListener& listener) const;
  const std::vector<PixelBox> bands_;
  const int layers_;
  const ExecutionContext context_;
  BlobStore store_;
};

}  // namespace slicecorr::detail
