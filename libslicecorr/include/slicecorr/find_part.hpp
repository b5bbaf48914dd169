// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file find_part.hpp
/// Where the images of an archive hold a part that another program sliced, and what else they light:
/// supports, rafts, other parts.
///
/// A part is looked for upright, in the eight ways in which an image may be turned and mirrored, anywhere
/// over the images and at any height, to the voxel. *Agreement* is the share of the part's surface, face
/// of a voxel by face, at which the images go from light to dark as well, at most one voxel away.
///
/// Objects are immutable and thread-safe once made. Errors are `InputError`, a cancelled `context`
/// `Cancelled`; reading also throws what the archive throws.
#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "slicecorr/mesh.hpp"
#include "slicecorr/orientation.hpp"
#include "slicecorr/parallel.hpp"
#include "slicecorr/target.hpp"

namespace slicecorr {

/// The least agreement of a part that is there.
inline constexpr double kLeastAgreement = 0.8;

/// A place of a part in the images of an archive.
struct PartPlace {
  /// From the part's own image, with column 0 at the least x of the mesh and row 0 at the largest y.
  Turn turn;
  PixelBox box;          ///< the part's box in the images
  int first_slice = 0;   ///< in which its lowest layer lies, -1 or more
  int slices = 0;        ///< from there on, 1 or more
  double agreement = 0;  ///< 0..1
};

/// "x 32.00, y 20.25 mm, from 5.050 mm above the platform on, turned by 90 degrees, mirrored": the
/// middle of the part, on the plate where `frame` says how it lies in the images.
std::string in_words(const PartPlace& place, const Grid& grid, const ImageFrame& frame);

/// A part in slices like those of an archive.
class SoughtPart {
 public:
  /// `mesh` in mm, as it stands on its supports but for turns about z; `grid`: of the archive, with
  /// sizes of pixels and layers. Throws where the part is larger than the images, or higher than all
  /// slices.
  SoughtPart(const TriangleMesh& mesh, const Grid& grid, const ExecutionContext& context = {});
  ~SoughtPart();
  SoughtPart(SoughtPart&&) noexcept;

  /// All its places whose agreement is at least `kLeastAgreement`, the best first; else the best
  /// one that there is; empty where the archive is dark. Places of which more than half is another
  /// one's are left out. The same for any number of threads.
  std::vector<PartPlace> find(const SliceSource& archive,
                              const ExecutionContext& context = {}) const;

  /// The part's coverage in the archive's slices, of `band`, which may reach beyond its box and the
  /// images: one call for each slice of the part, in order.
  void read_band(const PartPlace& place, const PixelBox& band, const SliceSource::Sink& sink) const;

 private:
  struct Impl;
  std::unique_ptr<const Impl> impl_;
};

/// What the slices of an archive light outside of parts, each grown by one voxel along x, y and z,
/// because places are whole voxels and other programs cut and round in their own way.
class OutsideParts final : public SliceSource {
 public:
  struct Placed {
    std::shared_ptr<const SoughtPart> part;
    PartPlace place;
  };
  /// `archive` must outlive this. Reads all of it once.
  OutsideParts(const SliceSource& archive, std::vector<Placed> parts,
               const ExecutionContext& context = {});
  const Grid& grid() const override { return archive_.grid(); }
  PixelBox bounds() const override { return bounds_; }
  ImageFrame frame() const override { return archive_.frame(); }
  void read_band(const PixelBox& band, const Sink& sink) const override;
  double volume_mm3() const { return volume_mm3_; }  ///< of its coverage, 0 or more

 private:
  const SliceSource& archive_;
  std::vector<Placed> parts_;
  PixelBox bounds_;
  double volume_mm3_ = 0;
};

}  // namespace slicecorr
