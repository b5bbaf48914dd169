// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Which voxels are solid, kept band by band, as bands are worked on, until they are followed slice by
/// slice. What is kept are changes from slice to slice, coded.
#pragma once

#include <cstddef>
#include <cstdint>
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
  static void sort_by_column(std::span<Flip> flips);
  std::size_t columns_;
  std::vector<Flip> flips_;
  bool sorted_ = true;
  unsigned kinds_ = 0;                 ///< that change anywhere; once sorted
  std::vector<std::uint64_t> before_;  ///< bits of the slice added last; empty: none
};

/// Takes codes of bands on any thread. What is more than some memory waits in a file without a name in
/// the folder for temporary files.
class KeptVoxels {
 public:
  /// Changes of one kind, band by band.
  using Pieces = std::vector<BlobStore::Blob>;
  using Stream = std::vector<Pieces>;

  KeptVoxels(std::vector<PixelBox> bands, int layers, const ExecutionContext& context);
  std::size_t bands() const { return bands_.size(); }
  Pieces keep(const std::vector<std::uint8_t>& code);
  struct Followed {
    const Stream& changes;
    const Stream* more = nullptr;  ///< changes beside these: what changes twice does not
    std::span<const Stream> delays =
        {};  ///< of each bit of the voxels' delays; empty: there are none
  };
  /// What the slices hold whose changes these are. Throws `Cancelled`.
  Bodies follow(const Followed& what, const Grid& grid, const ImageFrame& frame,
                const BodyAsk& ask) const;

 private:
  class Reader;
  const std::vector<PixelBox> bands_;
  const int layers_;
  const ExecutionContext context_;
  BlobStore store_;
};

}  // namespace slicecorr::detail
