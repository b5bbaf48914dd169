// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file dose_target.hpp
/// Doses that are wanted of a part's features, other than just enough: graded doses
/// (docs/graded-dose.md).
///
/// The wanted dose T is relative to the critical one and at least 1. Light of intensity phi = T - he
/// dT/dz, he the absorbance height base e, holds it in the limit of thin slices, so a dose can fall
/// and rise along z only so fast: phi is between that of black and that of full light.
///
/// Sources are immutable and thread-safe once made; all else is plain values and pure functions.
/// What throws says so.
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "slicecorr/target.hpp"

namespace slicecorr {

/// From which side doses are met that change too steeply for the light.
enum class DoseSide {
  nearest,   ///< half way between the other two
  at_least,  ///< nowhere below what is wanted
  at_most,   ///< nowhere above it
};
/// The side of this name: nearest, at-least, at-most. Throws `InputError` for others.
DoseSide dose_side_named(std::string_view name);

/// What the bytes of dose images stand for.
struct DoseScale {
  std::array<double, 256> dose;  ///< relative, 1 or more, by byte
  DoseSide side = DoseSide::nearest;

  DoseScale() { dose.fill(1.0); }
  double greatest() const;
  /// Bytes of pictures: 0 is a dose of 1, 255 one of `most`, in even steps. Throws `InputError`
  /// where `most` is not a number of at least 1.
  static DoseScale even(double most);
};

/// The doses wanted of a target's features. They count in voxels of coverage 1 alone.
struct DoseTarget {
  /// Bytes of the scale, an image per layer of the target and as large; must outlive this.
  const SliceSource* images = nullptr;
  DoseScale scale;
  /// Names of the regions that figures are told of, and the region of each byte.
  std::vector<std::string> regions;
  std::array<std::uint8_t, 256> region_of{};
};

/// Regions of a scale of even steps: up to eight ranges of doses.
void name_ranges(DoseTarget& doses);

/// A target with doses. Both must outlive it. Throws `InputError` when the images don't fit the
/// target in size, number of slices or pitch.
class GradedTarget final : public SliceSource {
 public:
  GradedTarget(const SliceSource& target, const DoseTarget& doses);
  const Grid& grid() const override { return target_.grid(); }
  PixelBox bounds() const override { return target_.bounds(); }
  ImageFrame frame() const override { return target_.frame(); }
  LayerHeights heights() const override { return target_.heights(); }
  const Recording* recording() const override { return target_.recording(); }
  void read_band(const PixelBox& band, const Sink& sink) const override {
    target_.read_band(band, sink);
  }
  void read_slices(const PixelBox& band, int first, int past, const Sink& sink) const override {
    target_.read_slices(band, first, past, sink);
  }
  bool reads_any_slices() const override { return target_.reads_any_slices(); }
  const SliceSource* edge_heights() const override { return target_.edge_heights(); }
  const SliceSource* left_alone() const override { return target_.left_alone(); }
  bool ends_below_last_node() const override { return target_.ends_below_last_node(); }
  /// Null where nothing more than 1 is wanted anywhere.
  const DoseTarget* doses() const override { return graded_ ? &doses_ : nullptr; }

 private:
  const SliceSource& target_;
  DoseTarget doses_;
  bool graded_;
};

/// Images that say in which of several regions a pixel lies: 0 in none, else 1 and on, the last of
/// those that cover half of the pixel or more.
class RegionImages final : public SliceSource {
 public:
  /// `slices` lies `begin` layers below the images' first one (less than 0: above it).
  struct Region {
    const SliceSource* slices;  ///< must outlive this; of the same display
    int begin = 0;
  };
  /// At most 255 regions.
  RegionImages(const Grid& grid, std::vector<Region> regions);
  const Grid& grid() const override { return grid_; }
  PixelBox bounds() const override { return bounds_; }
  void read_band(const PixelBox& band, const Sink& sink) const override;

 private:
  Grid grid_;
  std::vector<Region> regions_;
  PixelBox bounds_;
};

/// Light that holds a dose which changes by `slope_per_um` along z (away from the platform), in the
/// limit of thin slices. `height10_um`: the dose's absorbance height, base 10.
double graded_phi(double height10_um, double dose, double slope_per_um);
/// The least height in which a dose falls from `from` to `to` along z in full light, um; infinite
/// where that is not above `from`. 0 < `to` <= `from`.
double fall_height_um(double height10_um, double from, double to, double phi_max);
/// The same of a rise in black light, which must be below `from`. 0 < `from` <= `to`.
double rise_height_um(double height10_um, double from, double to, double phi_min);

}  // namespace slicecorr
