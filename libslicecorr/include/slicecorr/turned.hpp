// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file turned.hpp
/// Slices seen turned or mirrored, band by band.
///
/// Objects are immutable and thread-safe once made. Making one that reads its source throws as the
/// source does, and `DeviceError` when scratch can't be written.
#pragma once

#include <memory>
#include <optional>
#include <string>

#include "slicecorr/orientation.hpp"
#include "slicecorr/parallel.hpp"
#include "slicecorr/process.hpp"
#include "slicecorr/target.hpp"

namespace slicecorr {

/// The slices of `source`, each turned, and its edge heights where it has some. Turns that exchange rows and columns read the source once,
/// when made, and keep it in small blocks, run-length coded, in a `BlobStore` (256 MiB in memory,
/// the rest in scratch); others read it each time.
class TurnedSlices final : public SliceSource {
 public:
  /// `source` must outlive this. `frame`: how the images lie then, where more is known than the
  /// turn says.
  TurnedSlices(const SliceSource& source, const Turn& turn, const std::string& scratch_folder,
               const ExecutionContext& context = {}, const std::optional<ImageFrame>& frame = {});
  ~TurnedSlices() override;
  const Grid& grid() const override { return grid_; }
  PixelBox bounds() const override;
  ImageFrame frame() const override { return frame_; }
  LayerHeights heights() const override { return source_.heights(); }
  void read_band(const PixelBox& band, const Sink& sink) const override;
  const SliceSource* edge_heights() const override { return edge_heights_.get(); }

 private:
  class Transposed;
  const SliceSource& source_;
  Turn turn_;
  Grid grid_;
  ImageFrame frame_;
  std::unique_ptr<const Transposed> transposed_;
  std::unique_ptr<const TurnedSlices> edge_heights_;
};

/// A source as it is, or turned where that is needed.
class FittedSlices {
 public:
  /// As a printer's display shows them. They stay as they are when they are for a display already,
  /// and when the printer's file does not say how the plate lies in its images.
  static FittedSlices for_display(const SliceSource& source, const Printer& printer,
                                  const std::string& scratch_folder,
                                  const ExecutionContext& context = {});
  /// As the images of `other` lie, where both are known.
  static FittedSlices like(const SliceSource& other, const SliceSource& source,
                           const std::string& scratch_folder, const ExecutionContext& context = {});
  const SliceSource& operator*() const { return turned_ ? *turned_ : *source_; }

 private:
  explicit FittedSlices(const SliceSource& source) : source_(&source) {}
  const SliceSource* source_;
  std::unique_ptr<const TurnedSlices> turned_;
};

}  // namespace slicecorr
