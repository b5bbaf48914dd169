// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Corrections and predictions of bands whose columns do not all get the same light.
#pragma once

#include <array>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <vector>

#include "bands/design_groups.hpp"
#include "bands/robust_design.hpp"
#include "base/coded_band.hpp"
#include "cure/shown_slices.hpp"
#include "slicecorr/correct.hpp"
#include "slicecorr/place_models.hpp"
#include "slicecorr/setup.hpp"
#include "slicecorr/uncertain_print.hpp"

namespace slicecorr::detail {

/// The plans of a correction by value of light. Thread-safe.
class PlacePlans {
 public:
  /// Checks that `setup` can print `target` everywhere; throws as `correct_stack`. Reads the target
  /// once when it is not clear without which of its places are lit.
  PlacePlans(const SliceSource& target, const Setup& setup, const ExecutionContext& context);
  /// Has columns keep what is planned of even light (`InhibitedTuning::as_planned`). Before any plan is asked for.
  void keep_as_planned() { as_planned_ = true; }

  const PlaceModels& models() const { return models_; }
  bool even() const { return models_.even(); }
  int layers() const { return layers_; }
  /// Slices that will be shown: as many as the dimmest lit place needs.
  int all_layers() const { return all_layers_; }
  int levels() const { return levels_; }
  /// The plan of a value of light that occurs in a lit column.
  const CorrectionPlan& plan(std::uint8_t value) const;
  /// `CorrectionPlan::most_exchange` of all plans.
  std::optional<double> most_exchange() const { return most_exchange_; }
  /// What the correction is to allow for; null: nothing.
  const Uncertainty* robust() const { return robust_ ? &*robust_ : nullptr; }
  /// The prints of both cases of a robust correction where places have this value of light.
  const RobustCases& cases(std::uint8_t value) const;
  /// What a robust correction of columns together came to, without height errors; nothing before it is
  /// noted, once, before others read it.
  const std::optional<RobustFigures>& held() const { return held_; }
  void note(const RobustFigures& figures) const { held_ = figures; }
  /// The highest levels of columns of a value of light where light is even over the flow, empty
  /// elsewhere; to be used while this lives.
  BandCorrector::ColumnLevels even_levels(std::uint8_t value,
                                          const BandPredictor::PixelOfColumn& place) const;
  /// The plan of places that get the light of the calibration: of all where light is even.
  const CorrectionPlan& plan() const { return plan(models_.map().reference()); }

 private:
  Process process_;
  bool as_planned_ = false;
  std::optional<Uncertainty> robust_;
  std::optional<double> most_exchange_;
  mutable std::optional<RobustFigures> held_;
  PlaceModels models_;
  Grid images_;
  int layers_, all_layers_ = 0, levels_;
  mutable std::array<std::mutex, 256> making_;
  mutable std::array<std::unique_ptr<const CorrectionPlan>, 256> plans_;
  mutable std::array<std::unique_ptr<const RobustCases>, 256> cases_;
};

/// What all bands print together with the columns that are in none of their groups.
Prediction whole_image(const Prediction& in_groups, const PlaceModels& models, const Grid& grid,
                       int slices, const LightCounts& in_all_groups,
                       const ShownSlices* recorded = nullptr);

/// Where places differ in both lights: by how much blue light of a value is more for the UV light of the place
/// that has least of it over its blue light; else 1.
double paired_share(const PlaceModels& models, std::uint8_t value);

/// The window under places of several models together; see WindowTotal. For one thread at a time.
class PlaceWindows {
 public:
  PlaceWindows(const PlaceModels& models, int slices) : models_(models), slices_(slices) {}
  void merge(std::uint8_t value, const WindowWatch& band);
  DeadZones result() const;
  /// Greatest curing intensity of each slice, mW/cm²; 0 where nothing is shown.
  std::vector<double> greatest_mw_cm2() const;

 private:
  const PlaceModels& models_;
  int slices_;
  std::array<std::unique_ptr<WindowTotal>, 256> totals_;
};

}  // namespace slicecorr::detail
