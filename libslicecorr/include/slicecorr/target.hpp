// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file target.hpp
/// What is to be printed, as the steps after it see it: the coverage of every voxel, band by band.
///
/// A *band* is a range of image rows through all slices. Columns are independent, so bands are
/// worked on in parallel with nothing shared, and no result depends on the number of threads.
///
/// Slices are stairs. Where a target knows how high the design's own surface lies beside a node, it
/// says so for that edge of the column: its *edge height*, a byte per edge (`edge_height_slices`).
///
/// All is thread-safe once made. Reading throws what the source throws: `InputError` where it is
/// damaged, `DeviceError` where a disk fails, and what the sink throws.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <vector>

#include "slicecorr/grid.hpp"
#include "slicecorr/layer_heights.hpp"
#include "slicecorr/orientation.hpp"

namespace slicecorr {

struct Recording;
struct DoseTarget;

/// A source of slices: a sliced mesh, or an archive. Several threads may read bands at once.
class SliceSource {
 public:
  virtual ~SliceSource() = default;
  virtual const Grid& grid() const = 0;
  /// No pixel outside this box is lit in any slice.
  virtual PixelBox bounds() const = 0;
  /// How the images lie. Those of `slice` show the plate and are turned on their way to the
  /// display.
  virtual ImageFrame frame() const { return {}; }
  /// Of a recorded stack, whose images are no slices: which of them was lit in which slice. Null:
  /// image n is shown in slice n.
  virtual const Recording* recording() const { return nullptr; }
  /// Heights of layers, where the source says that they differ.
  virtual LayerHeights heights() const { return {}; }
  /// Gives rows [y0, y1) and columns [x0, x1) of every slice to `sink`, from slice 0 on. `rows`
  /// holds (y1 - y0) * (x1 - x0) bytes, row by row: coverage 0..255 of a target, or grey values
  /// 0..255 of a stack. A null pointer stands for a slice that is black there.
  using Sink = std::function<void(int slice, const std::uint8_t* rows)>;
  virtual void read_band(const PixelBox& band, const Sink& sink) const = 0;
  /// The same of slices [first, past) only.
  virtual void read_slices(const PixelBox& band, int first, int past, const Sink& sink) const {
    read_band(band, [&](int n, const std::uint8_t* rows) {
      if (n >= first && n < past) sink(n, rows);
    });
  }
  /// Whether `read_slices` takes no longer than its slices do.
  virtual bool reads_any_slices() const { return false; }
  /// The edge heights of a target, or null where edges lie at nodes: one image per node, 0 to
  /// `grid().layers`, of the same size and frame; 0 where no edge is or it has no height of its own.
  /// Lives as long as the source.
  virtual const SliceSource* edge_heights() const { return nullptr; }
  /// What of a target is shown as it is, beside the part, or null where nothing is: images of the
  /// same number, size and frame with the grey value (1..255) of each voxel that is left alone; 0
  /// where none is. The target's own coverage is 0 there. Lives as long as the source.
  virtual const SliceSource* left_alone() const { return nullptr; }
  /// Whether some edge of the part's end lies below the last node, by the edge heights.
  virtual bool ends_below_last_node() const;
  /// The doses that are wanted of a target's features (dose_target.hpp); null: just enough, and as
  /// much as `Process::omega_max` allows.
  virtual const DoseTarget* doses() const { return nullptr; }
};

/// The edge height of an edge at its node.
inline constexpr std::uint8_t kEdgeAtNode = 128;
/// How far an edge lies below its node, away from the platform, in slices: -1/2..1/2. `byte`: its
/// edge height, 1..255.
constexpr double edge_height_slices(std::uint8_t byte) { return (byte - kEdgeAtNode) / 254.0; }
/// The byte of an edge `slices` below its node, the nearest in range.
constexpr std::uint8_t edge_height_byte(double slices) {
  const double v = kEdgeAtNode + 254.0 * slices;
  // Rounded: half of the odd numbers is cut off.
  return v < 1.0     ? std::uint8_t{1}
         : v > 255.0 ? std::uint8_t{255}
                     : static_cast<std::uint8_t>((static_cast<int>(2.0 * v) + 1) / 2);
}

/// The slices of a source without its edge heights. `source` must outlive this.
class SlicesAlone final : public SliceSource {
 public:
  explicit SlicesAlone(const SliceSource& source) : source_(source) {}
  const Grid& grid() const override { return source_.grid(); }
  PixelBox bounds() const override { return source_.bounds(); }
  ImageFrame frame() const override { return source_.frame(); }
  const Recording* recording() const override { return source_.recording(); }
  void read_band(const PixelBox& band, const Sink& sink) const override {
    source_.read_band(band, sink);
  }
  void read_slices(const PixelBox& band, int first, int past, const Sink& sink) const override {
    source_.read_slices(band, first, past, sink);
  }
  bool reads_any_slices() const override { return source_.reads_any_slices(); }
  const DoseTarget* doses() const override { return source_.doses(); }
  const SliceSource* left_alone() const override { return source_.left_alone(); }

 private:
  const SliceSource& source_;
};

/// Size, scale and frame without images: for functions that do not look at voxels.
class GridOnly final : public SliceSource {
 public:
  GridOnly(const Grid& grid, const ImageFrame& frame) : grid_(grid), frame_(frame) {}
  const Grid& grid() const override { return grid_; }
  ImageFrame frame() const override { return frame_; }
  PixelBox bounds() const override { return {}; }
  void read_band(const PixelBox&, const Sink&) const override {}

 private:
  Grid grid_;
  ImageFrame frame_;
};

/// Rows of a band for this grid, 1 or more. Depends on the grid alone, so that files do not depend
/// on threads.
int band_rows(const Grid& grid);

}  // namespace slicecorr
