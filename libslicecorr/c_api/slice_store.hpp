// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// A stack of slices in memory: written slice by slice or band by band, read either way.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <memory>
#include <mutex>
#include <string>

#include "slicecorr/stack.hpp"
#include "stack/blob_store.hpp"

namespace slicecorr::c_api {

/// Each band of each slice is a blob of its own, run-length coded, in a `BlobStore`: 256 MiB in
/// memory, the rest in a scratch file. What was never put is black. Different slices, and different
/// bands of `band_rows(grid)` rows, may be put at once; nothing may be put while others read.
class SliceStore final : public SliceSource {
 public:
  SliceStore(const Grid& grid, const std::string& scratch_folder,
             const ExecutionContext& context = {});

  const Grid& grid() const override { return grid_; }
  PixelBox bounds() const override;
  ImageFrame frame() const override { return frame_; }
  void set_frame(const ImageFrame& frame) { frame_ = frame; }
  void read_band(const PixelBox& box, const Sink& sink) const override;

  /// `stride`: bytes from one row to the next; may be negative.
  void put(int slice, const std::uint8_t* pixels, std::ptrdiff_t stride);
  void get(int slice, std::uint8_t* pixels, std::ptrdiff_t stride) const;
  /// Columns and rows of `box`, which lies in one band; all else in the band's slice is black.
  /// Null: black.
  void put_band(int slice, const PixelBox& box, const std::uint8_t* rows);

 private:
  BlobStore::Blob& blob(int band, int slice) const;
  /// Puts the lit part of rows [y0, y1), columns [x0, x1); `pixels` is at row y0 and column x0.
  void put_rows(int slice, const PixelBox& box, const std::uint8_t* pixels, std::ptrdiff_t stride);
  struct Scratch;
  /// Copies what `from` has of `box` to `out`, which is at the box's first row and column.
  void copy(const BlobStore::Blob& from, int band, const PixelBox& box, Scratch& scratch,
            std::uint8_t* out, std::ptrdiff_t stride) const;

  Grid grid_;
  ImageFrame frame_;
  int rows_;
  BlobStore store_;
  /// Band by band; of size 0 where it is black. Zeroed memory of the system, so that black bands
  /// take none.
  std::unique_ptr<BlobStore::Blob[], decltype(&std::free)> index_;
  PixelBox bounds_;
  mutable std::mutex mutex_;  ///< of bounds
};

/// Copies all of `source` and how it lies, in parallel.
std::unique_ptr<SliceStore> keep_slices(const SliceSource& source, const std::string& stage,
                                        const std::string& scratch_folder,
                                        const ExecutionContext& context);

}  // namespace slicecorr::c_api
