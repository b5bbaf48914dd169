// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file left_alone.hpp
/// A target beside which something is shown as it is sliced: supports, rafts.
///
/// What is left alone is neither a feature nor a gap: whatever prints there is right, and it has no
/// edges. Its light counts for all that lies nearer to the platform in the same columns, and what is
/// corrected there counts on it.
///
/// Supports touch the part, and a target may hold them or not. So what of a voxel is left alone is
/// decided by its light: where what is left alone covers at least half of what the target covers, the
/// voxel is left alone and shows the greater of both; elsewhere it is the part's.
///
/// Objects are immutable and thread-safe once made. Only making one throws: `InputError`.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "slicecorr/mesh.hpp"
#include "slicecorr/parallel.hpp"
#include "slicecorr/process.hpp"
#include "slicecorr/target.hpp"

namespace slicecorr {

/// Slices that are left alone.
struct LeftAlone {
  const SliceSource* slices = nullptr;
  std::string name;  ///< for complaints
  /// Whether there may be fewer slices than the target has: of a mesh, which ends where it ends.
  bool may_end_early = false;
};

/// A target without what is left alone, which is its `left_alone()`.
class LeavingAlone final : public SliceSource {
 public:
  /// `target` and all slices must outlive this. Throws where they have other sizes, pitches, numbers
  /// of slices or frames than the target.
  LeavingAlone(const SliceSource& target, std::vector<LeftAlone> left_alone);
  const Grid& grid() const override { return target_.grid(); }
  PixelBox bounds() const override { return bounds_; }
  ImageFrame frame() const override { return target_.frame(); }
  LayerHeights heights() const override { return target_.heights(); }
  void read_band(const PixelBox& band, const Sink& sink) const override;
  const SliceSource* edge_heights() const override { return target_.edge_heights(); }
  bool ends_below_last_node() const override { return target_.ends_below_last_node(); }
  const SliceSource* left_alone() const override { return &shown_; }

 private:
  /// The pixels that are left alone.
  class LeftPixels final : public SliceSource {
   public:
    explicit LeftPixels(const LeavingAlone& whole) : whole_(whole) {}
    const Grid& grid() const override { return whole_.grid(); }
    PixelBox bounds() const override { return whole_.bounds(); }
    ImageFrame frame() const override { return whole_.frame(); }
    void read_band(const PixelBox& band, const Sink& sink) const override;

   private:
    const LeavingAlone& whole_;
  };
  /// Gives the target's rows and those that are left alone, either null where black.
  template <typename Take>
  void read_both(const PixelBox& band, Take take) const;

  const SliceSource& target_;
  std::vector<LeftAlone> left_alone_;
  PixelBox bounds_;
  LeftPixels shown_{*this};
};

/// The slices of a target as they are shown where nothing is corrected: with what is left alone.
/// `target` must outlive this.
class AsSliced final : public SliceSource {
 public:
  explicit AsSliced(const SliceSource& target) : target_(target) {}
  const Grid& grid() const override { return target_.grid(); }
  PixelBox bounds() const override { return target_.bounds(); }
  ImageFrame frame() const override { return target_.frame(); }
  LayerHeights heights() const override { return target_.heights(); }
  void read_band(const PixelBox& band, const Sink& sink) const override;

 private:
  const SliceSource& target_;
};

/// How meshes that are left alone lie.
struct MeshesLeftAlone {
  Placement placement;
  bool antialias = true;
  /// Where the origin of the meshes lies: x and y on the plate, from its corner at the least x and y,
  /// and z above the platform, mm. A part that was sliced from its own mesh has its origin elsewhere
  /// than on that corner.
  Point3 origin_mm{};
};

/// Meshes that a target of another program holds: what it lights outside of them is left alone.
struct PartsInside {
  std::vector<std::string> files;
  Placement placement;
};

/// A target and the files of what is left alone beside it: meshes, which are sliced on its grid, and
/// stacks, which must have it.
class LeftAloneFiles {
 public:
  /// `target` must outlive this. Where parts lie inside it (find_part.hpp), and how much is left alone
  /// outside, is told through `context`. Throws `InputError`, naming the file: as `read_mesh`,
  /// `MeshSlices`, `StackReader`, `LeavingAlone` and `SoughtPart`, for stacks that are corrected or
  /// recorded, and for parts that the target does not hold.
  LeftAloneFiles(const SliceSource& target, const std::vector<std::string>& files,
                 const MeshesLeftAlone& meshes, const Printer& printer,
                 const std::string& scratch_folder, const ExecutionContext& context = {},
                 const PartsInside& inside = {});
  ~LeftAloneFiles();
  LeftAloneFiles(const LeftAloneFiles&) = delete;
  LeftAloneFiles& operator=(const LeftAloneFiles&) = delete;
  /// `target` itself where there are no files.
  const SliceSource& operator*() const;

 private:
  struct Impl;
  std::unique_ptr<const Impl> impl_;
};

}  // namespace slicecorr
