// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file uneven_slices.hpp
/// Meshes cut into layers of different heights, as they are given or thin where slopes are gentle
/// (docs/layerwise.md).
///
/// Plain values and functions are thread-safe; errors are `InputError`.
#pragma once

#include <memory>
#include <vector>

#include "slicecorr/layer_heights.hpp"
#include "slicecorr/mesh.hpp"
#include "slicecorr/slice.hpp"

namespace slicecorr {

/// The height of thin slices of which the middle of every layer is one's lower node, um: half of the
/// greatest common measure of the heights. Throws `InputError` where a height is not from 1 to 1000 um,
/// or where that measure is less than 2 um.
double thin_slice_um(const LayerHeights& heights);

/// Slices of layers of different heights out of thin ones: each is cut in the middle of its layer. `thin`
/// outlives this; it was made with `thin_slice_um` as its layers, raised by half of them
/// (`SliceOptions::raised_um`).
class UnevenSlices final : public SliceSource {
 public:
  /// A layer is there where the part reaches its middle. `usual_um`: what the grid says of all layers; 0: the
  /// height of the last.
  UnevenSlices(const MeshSlices& thin, LayerHeights heights, double usual_um = 0);
  const Grid& grid() const override { return grid_; }
  PixelBox bounds() const override { return thin_.bounds(); }
  ImageFrame frame() const override { return thin_.frame(); }
  LayerHeights heights() const override { return heights_; }
  void read_band(const PixelBox& band, const Sink& sink) const override;
  void read_slices(const PixelBox& band, int first, int past, const Sink& sink) const override;
  bool reads_any_slices() const override { return thin_.reads_any_slices(); }

 private:
  const MeshSlices& thin_;
  LayerHeights heights_;
  Grid grid_;
  std::vector<int> cut_;  ///< thin slice of each layer
};

/// A mesh cut into layers of different heights, or, where they are alike, of `SliceOptions::layer_um`. Throws as
/// `MeshSlices` and `thin_slice_um`.
class MeshInLayers {
 public:
  /// `edge_defects`: as `MeshSlices` takes them.
  MeshInLayers(TriangleMesh mesh, const Printer& printer, const SliceOptions& options,
               const LayerHeights& heights, const ExecutionContext& context = {},
               const EdgeDefects* edge_defects = nullptr);
  const SliceSource& operator*() const;

 private:
  std::unique_ptr<const MeshSlices> cuts_;
  std::unique_ptr<const UnevenSlices> uneven_;  ///< null: the cuts are the layers
};

/// Heights from `least_um` to `most_um`, multiples of `least_um`, each the most with which no slope of the
/// part lies further from its steps than `least_um`: a layer is at most `least_um` / |n_z| high, n_z that
/// of the surfaces in it. Layers end at level faces, where these lie at a multiple of `least_um`. Throws
/// `InputError` where the two do not make such heights.
LayerHeights adaptive_heights(const TriangleMesh& mesh, double least_um, double most_um);

}  // namespace slicecorr
