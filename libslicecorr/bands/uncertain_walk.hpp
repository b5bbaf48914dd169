// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// How sure a prediction is: bands walked once more, beside their prediction.
#pragma once

#include <functional>
#include <memory>
#include <mutex>
#include <optional>

#include "bands/design_band.hpp"
#include "bands/surface_collector.hpp"
#include "slicecorr/setup.hpp"
#include "slicecorr/uncertain_print.hpp"

namespace slicecorr::detail {

/// What is seen of a slice: its pixels; null: light off.
using ShownSlice = std::function<const std::uint8_t*(int slice)>;

/// What all bands add up to. Thread-safe; the order of bands does not matter.
class UncertainTotal {
 public:
  /// `box`: pixels that may have edges. Throws as `check_uncertain`, and under UV light as
  /// `nearby_models`.
  UncertainTotal(const Setup& setup, double layer_um, const PixelBox& box);
  /// A band to walk beside a prediction, where light spreads; and then its figures.
  UncertainBand band(const CureModel& model, int all_layers, std::size_t columns,
                     bool at_heights) const;
  void add(UncertainBand& band, const BandPredictor::PixelOfColumn& place);
  /// Columns that share a model: `all_layers` slices of `shown` and `design`. `at_heights`: as
  /// `UncertainBand::aim_at_heights`.
  void add(const CureModel& model, std::size_t columns, const ShownSlice& shown,
           const CodedDesign& design, int all_layers, bool at_heights,
           const BandPredictor::PixelOfColumn& place, const ExecutionContext& context);
  /// Once, after all bands.
  std::shared_ptr<const UncertainPrint> result(
      const std::optional<RobustFigures>& robust = std::nullopt) const;

 private:
  const Uncertainty uncertainty_;
  std::optional<NearbyModels> nearby_;  ///< under UV light
  SurfaceCollector maps_;
  std::mutex merging_;
  UncertainPrint total_;
};

}  // namespace slicecorr::detail
