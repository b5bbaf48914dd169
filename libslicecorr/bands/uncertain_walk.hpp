// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// How sure a prediction is: bands walked once more, beside their prediction.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>

#include "bands/design_band.hpp"
#include "bands/design_groups.hpp"
#include "bands/surface_collector.hpp"
#include "slicecorr/place_models.hpp"
#include "slicecorr/setup.hpp"
#include "slicecorr/uncertain_print.hpp"

namespace slicecorr::detail {

/// What is seen of a slice: its pixels; null: light off.
using ShownSlice = std::function<const std::uint8_t*(int slice)>;

/// The process of places with a value of light, with the UV light that the lamp gives there, whatever the
/// resin then turns out to be.
Process with_known_uv(const PlaceModels& models, std::uint8_t value);
/// Whether what levels of pulses do is off in other ways than steady light would be.
bool pulses_differ(const PlaceModels& models, const Uncertainty& uncertainty);
/// What `BandDerivatives` need at such places; null where derivatives have a recursion. Throws as
/// `nearby_models`.
std::unique_ptr<const NearbyModels> nearby_of_place(const PlaceModels& models, std::uint8_t value,
                                                    const Uncertainty& uncertainty);

/// What all bands add up to. Thread-safe; the order of bands does not matter.
class UncertainTotal {
 public:
  /// `models`: of the setup's print, which must outlive this; `box`: pixels that may have edges. Throws as
  /// `check_uncertain`, and as `nearby_models` where they are needed.
  UncertainTotal(const Setup& setup, const PlaceModels& models, const PixelBox& box);
  /// A band to walk beside a prediction, where light spreads; and then its figures.
  UncertainBand band(std::uint8_t value, int all_layers, std::size_t columns,
                     bool at_heights) const;
  void add(UncertainBand& band, const BandPredictor::PixelOfColumn& place);
  /// Slices that columns show, and the design's after them.
  struct Walked {
    ShownSlice shown;
    int all_layers;
    bool at_heights;  ///< as `UncertainBand::aim_at_heights`
  };
  /// Columns that share a value of light; of the group light, number and places count.
  void add(const DesignGroup& group, const Walked& slices, const CodedDesign& design,
           const ExecutionContext& context);
  /// Once, after all bands.
  std::shared_ptr<const UncertainPrint> result(
      const std::optional<RobustFigures>& robust = std::nullopt) const;

 private:
  /// Null where derivatives have a recursion.
  const NearbyModels* nearby(std::uint8_t value) const;
  const Uncertainty uncertainty_;
  const PlaceModels& models_;
  mutable std::mutex making_;
  mutable std::array<bool, 256> made_{};
  mutable std::array<std::unique_ptr<const NearbyModels>, 256> nearby_;
  SurfaceCollector maps_;
  std::mutex merging_;
  UncertainPrint total_;
};

}  // namespace slicecorr::detail
