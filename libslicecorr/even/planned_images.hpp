// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What a correction for an even dead zone will show, before anything is solved.
#pragma once

#include "bands/design_band.hpp"
#include "bands/place_plans.hpp"
#include "slicecorr/target.hpp"

namespace slicecorr::detail {

/// The slices of a target as they will be lit under the even light of a setup: grey values, by
/// `EvenColumn`, and what the target leaves alone as it is. Slices after the target's last one are left
/// out. Thread-safe once made; `target` must outlive it.
class PlannedImages final : public SliceSource {
 public:
  /// Throws as `correct_stack`.
  PlannedImages(const SliceSource& target, const Setup& setup, const ExecutionContext& context)
      : target_(target), plans_(target, setup, context) {}
  const Grid& grid() const override { return target_.grid(); }
  PixelBox bounds() const override { return target_.bounds(); }
  ImageFrame frame() const override { return target_.frame(); }
  void read_band(const PixelBox& band, const Sink& sink) const override;

 private:
  const SliceSource& target_;
  PlacePlans plans_;
};

/// A target with what is left alone, as images cover both. `target` must outlive it.
class WholeTarget final : public SliceSource {
 public:
  explicit WholeTarget(const SliceSource& target) : target_(target) {}
  const Grid& grid() const override { return target_.grid(); }
  PixelBox bounds() const override { return target_.bounds(); }
  ImageFrame frame() const override { return target_.frame(); }
  void read_band(const PixelBox& band, const Sink& sink) const override {
    read_as_sliced(target_, band, sink);
  }

 private:
  const SliceSource& target_;
};

/// What of a target is there for the resin when images are shown: pixels that are lit, covered as in
/// the target or, beyond a feature's end, whole. Where a feature is still dark before its edge, the
/// resin is liquid and no part. Both must outlive it.
class LitPart final : public SliceSource {
 public:
  LitPart(const SliceSource& target, const SliceSource& images)
      : target_(target), images_(images) {}
  const Grid& grid() const override { return target_.grid(); }
  PixelBox bounds() const override { return target_.bounds(); }
  ImageFrame frame() const override { return target_.frame(); }
  const SliceSource* left_alone() const override { return target_.left_alone(); }
  void read_band(const PixelBox& band, const Sink& sink) const override;

  static std::uint8_t lit(std::uint8_t pixel, std::uint8_t covered) {
    if (pixel == 0) return 0;
    return covered > 0 ? covered : std::uint8_t{255};
  }

 private:
  const SliceSource &target_, &images_;
};

}  // namespace slicecorr::detail
