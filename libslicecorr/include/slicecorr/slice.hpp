// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file slice.hpp
/// Mesh to slices: plane cuts at mid-layer height, non-zero winding rule, area coverage per pixel;
/// and the heights at which the mesh's own surface crosses the centres of pixels.
///
/// `MeshSlices` is immutable and thread-safe once made; all else is plain values. Only making one
/// throws: `InputError`, and `Cancelled`.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>

#include "slicecorr/mesh.hpp"
#include "slicecorr/parallel.hpp"
#include "slicecorr/process.hpp"
#include "slicecorr/target.hpp"

namespace slicecorr {

struct SliceOptions {
  double layer_um = 50;  ///< slice height hs, 1..1000
  /// Exact area coverage in 256 levels; off: a pixel is lit where its centre is inside.
  bool antialias = true;
  /// Where the centre of the parts' bounding box lands on the plate, mm from its corner at the
  /// smallest x and y; the middle of the display when not given.
  std::optional<std::array<double, 2>> center_mm;
  /// The height of the mesh that lies on the platform, mm, at most its least z, which it is when not
  /// given.
  std::optional<double> platform_z_mm;
  /// How far the part is raised above the platform, um, 0 or more: cuts go through it that much lower.
  double raised_um = 0;
  /// Whether there are `MeshSlices::edge_heights`. Slices are the same with and without.
  bool edge_heights = false;
  /// Its growth of first layers is taken off their outlines. What shrinks is in the mesh already (`Placement`); both
  /// are what the slices' frame says that they were made for.
  Shrinkage shrinkage{};
};

/// Figures of the slicing itself.
struct SliceReport {
  std::size_t bridged_slices = 0;  ///< slices with open contours that had to be closed
  std::size_t bridges = 0;         ///< number of bridges
  double longest_bridge_mm = 0;    ///< 0 without bridges
  /// Volume that bridges may have got wrong. A bridge is straight, while the surface that is
  /// missing there may have bulged to either side: a half circle over each bridge is counted.
  double bridged_volume_mm3 = 0;
  /// Volume that the contours enclose with their bridges, counted only where there are some; what
  /// lies in two bodies counts twice.
  double volume_mm3 = 0;
  std::size_t turned_triangles = 0;  ///< triangles that were cut as if they faced the other way
};

/// What of a part lies between two neighbouring mid-layers without reaching either, over pixel
/// centres: sliced, it prints nothing.
struct ThinFeatures {
  std::uint64_t columns = 0;     ///< places: pixel columns, each as often as it has such a feature
  std::uint64_t of_columns = 0;  ///< pixel columns that meet the part
  double volume_mm3 = 0;
  double thickest_um = 0;  ///< height of the thickest of them, less than a slice
  /// Where on the plate the first of these is, from the corner at the least x and y, and its lower
  /// end above the platform, mm.
  double x_mm = 0, y_mm = 0, z_mm = 0;
};

/// Slices `mesh` (mm, all parts of the plate) for `printer`. The cuts are made when bands are read:
/// memory is that of the mesh. The mesh's least z, or the height that the options say, is put on the
/// platform; slice n is cut at (n + 1/2) * layer_um above it.
///
/// Edge heights are those of the line through the pixel's centre, by the same winding rule: where
/// it is solid at one of the middles of two neighbouring layers and not at the other, the edge
/// between them has the height of the crossing, or, of several, the one that keeps the solid length
/// between the two middles. What stands on the platform has no height there, and columns that pass
/// through a hole of the mesh have none at all.
///
/// `edge_defects`: those of the mesh as `inspect` finds them, where they are known already; must
/// fit it. Throws `InputError` when the part is larger than the display or the stage (naming the
/// excess in mm) or thinner than half a layer.
class MeshSlices final : public SliceSource {
 public:
  MeshSlices(TriangleMesh mesh, const Printer& printer, const SliceOptions& options,
             const ExecutionContext& context = {}, const EdgeDefects* edge_defects = nullptr);
  ~MeshSlices() override;
  MeshSlices(MeshSlices&&) noexcept;
  const Grid& grid() const override;
  PixelBox bounds() const override;
  ImageFrame frame() const override;
  void read_band(const PixelBox& band, const Sink& sink) const override;
  void read_slices(const PixelBox& band, int first, int past, const Sink& sink) const override;
  bool reads_any_slices() const override { return true; }
  /// Null when `SliceOptions::edge_heights` is off. Found for all nodes whenever a band is read;
  /// lives as long as the slices, also where these are moved to.
  const SliceSource* edge_heights() const override;
  bool ends_below_last_node() const override;
  const SliceReport& report() const;
  /// The corners of the box around the mesh, mm, as the mesh lay before it was put on the plate.
  const std::array<Point3, 2>& box_mm() const;
  /// Looks at all columns of the part, on all threads; nothing is found where there are no edge
  /// heights. Throws `Cancelled`.
  ThinFeatures thin_features(const ExecutionContext& context = {}) const;

 private:
  class Heights;
  struct Impl;
  /// The slices as the mesh is cut.
  void cut_slices(const PixelBox& band, int first, int past, const Sink& sink) const;
  std::unique_ptr<Impl> impl_;
};

}  // namespace slicecorr
