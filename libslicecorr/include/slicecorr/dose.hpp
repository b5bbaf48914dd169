// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file dose.hpp
/// The dose that slices leave in a band of pixel columns: one interface for all cure models.
///
/// Slices are given from the last to the first. After slice n the dose inside layer n is final: at
/// its lower end (just above node n + 1), in its middle, and at its upper end (just below node n).
/// Continuous exposure is steady across nodes; layer by layer the dose jumps there, so that the
/// upper end of layer n and the lower end of layer n - 1 differ (the sawtooth). Without UV light
/// the dose rises or falls all through a layer, so that its ends bound it; under UV light, and
/// where several images share a slice, it has peaks and dips inside. Doses are relative: 1 gels the
/// resin.
///
/// Objects are for one thread at a time; `column_dose` is thread-safe. Nothing here throws anything
/// of its own.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "slicecorr/cure.hpp"

namespace slicecorr {

namespace detail {
class DoseWalker;
}  // namespace detail

/// The light of a column under UV light, where light spreads from column to column: in place of a
/// grey level, the front that blue and UV light have together and how much blue light there is. See
/// `InhibitedKernel::by_front`.
struct FrontLight {
  float amount = 0;
  std::uint16_t front = 0;
  bool operator==(const FrontLight&) const = default;
};

/// One of the images that were shown while the window passed a slice (recording.hpp).
struct ImageShowing {
  const std::uint8_t* pixels = nullptr;  ///< 0..255, one per column
  /// Share of the slice's light: what a slice adds to a dose is the sum over its showings of light
  /// times what the image alone would add.
  double light = 1;
  int setting = 0;  ///< of UV light, 0..settings() - 1, see InhibitedKernel
  /// Where in the slice it was lit, from its end towards the platform (0) to the other (1).
  /// Continuous exposure without UV light takes its light as spread over that stretch, all other
  /// models as spread over the slice, or as given where the window stands.
  double from = 0, to = 1;
  /// What the image alone gives each column, relative intensity, where light spreads from column to
  /// column; null: that of its pixel's grey level. Not under UV light.
  const double* phi = nullptr;
  /// The same under UV light, for models whose kernel is by fronts; null: light of grey levels.
  const FrontLight* fronts = nullptr;
};

/// A relative dose that differs from 1 by less counts as 1 where a run might be split. Doses under
/// UV light are right to this (InhibitedKernel::kTailShare); rounding is below 1e-9 of the dose.
inline constexpr double kSameDose = 1e-6;

/// What the dose does between the two ends of a layer.
struct InsideLayer {
  double least = 0;  ///< the least dose, both ends included
  /// Where the dose passes 1, as distances from the layer's lower end in slices, 0..1, ascending:
  /// an even number of them where both ends lie on one side of 1, else an odd number.
  std::vector<double> crossings;
};

/// The layer of a column that has shown one light in all slices near it: from such a layer to the next only what far
/// slices gave changes, at all places of the layer alike.
struct SteadyLayer {
  double far = 0;  ///< dose at the lower end from slices that are not near
  double lower = 0, middle = 0, upper = 0;
  int setting = 0, level = 0;
  double weight = 0;
  bool same_light(const SteadyLayer& o) const {
    return setting == o.setting && level == o.level && weight == o.weight;
  }
};

class BandDose {
 public:
  /// `model` must outlive this.
  BandDose(const CureModel& model, std::size_t columns);
  ~BandDose();
  BandDose(BandDose&&) noexcept;

  /// Slice `slice` shows `pixels` (0..255, one per column, see pixel_curve); null: light off, as
  /// after the end of a stack. Slices follow each other downwards in number.
  void add_slice(int slice, const std::uint8_t* pixels);
  /// The same of several images; none: light off. Their pixels must stay until the next slice, for
  /// `inside`. See docs/recording.md for how exact it is.
  void add_slice(int slice, std::span<const ImageShowing> showings);

  const double* lower() const;   ///< relative dose at the lower end of the layer, per column
  const double* middle() const;  ///< in its middle
  const double* upper() const;   ///< at its upper end
  /// Per column, not 0 where the dose may turn inside the layer; null: nowhere, it rises or falls
  /// all through.
  const std::uint8_t* turning() const;
  /// The layer of one column. Exact without UV light; with it edges are right to 0.01 um, and
  /// `least` to 1e-6. `known`: where the layer's least dose is not below this, `least` may be any
  /// dose not below it.
  void inside(std::size_t column, double known, InsideLayer& out) const;
  /// Whether the layer of a column is a steady one whose dose may turn inside; `out`: that layer. Of two with the same
  /// light the one with less from far has less at each place.
  bool steady(std::size_t column, SteadyLayer& out) const;
  /// `inside` of a layer that `steady` gave, at any time after it.
  void inside(const SteadyLayer& layer, double known, InsideLayer& out) const;

 private:
  const CureModel& model_;
  std::unique_ptr<detail::DoseWalker> walker_;
};

/// Doses along one column whose slices show `pixels`, first slice first.
struct ColumnDose {
  std::vector<double> lower, middle, upper;  ///< per layer
};
ColumnDose column_dose(const CureModel& model, const std::vector<std::uint8_t>& pixels);

}  // namespace slicecorr
