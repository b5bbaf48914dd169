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

#include "base/coded_band.hpp"
#include "cure/shown_slices.hpp"
#include "pipeline/design_band.hpp"
#include "slicecorr/pipeline.hpp"
#include "slicecorr/place_models.hpp"

namespace slicecorr::detail {

/// The plans of a correction by value of light. Thread-safe.
class PlacePlans {
 public:
  /// Checks that `setup` can print `target` everywhere; throws as `correct_stack`. Reads the target
  /// once when it is not clear without which of its places are lit.
  PlacePlans(const SliceSource& target, const Setup& setup, const ExecutionContext& context);

  const PlaceModels& models() const { return models_; }
  bool even() const { return models_.even(); }
  int layers() const { return layers_; }
  /// Slices that will be shown: as many as the dimmest lit place needs.
  int all_layers() const { return all_layers_; }
  int levels() const { return levels_; }
  /// The plan of a value of light that occurs in a lit column.
  const CorrectionPlan& plan(std::uint8_t value) const;
  /// What the correction is to allow for; null: nothing.
  const Uncertainty* robust() const { return robust_ ? &*robust_ : nullptr; }
  /// The highest levels of columns of a value of light where light is even over the flow, empty
  /// elsewhere; to be used while this lives.
  BandCorrector::ColumnLevels even_levels(std::uint8_t value,
                                          const BandPredictor::PixelOfColumn& place) const;
  /// The plan of places that get the light of the calibration: of all where light is even.
  const CorrectionPlan& plan() const { return plan(models_.map().reference()); }

 private:
  Process process_;
  std::optional<Uncertainty> robust_;
  PlaceModels models_;
  Grid images_;
  int layers_, all_layers_ = 0, levels_;
  mutable std::array<std::mutex, 256> making_;
  mutable std::array<std::unique_ptr<const CorrectionPlan>, 256> plans_;
};

/// A band read once and divided: the columns that are lit in any of its sources, by value of light.
struct GroupedBand {
  struct Group {
    std::uint8_t value = 0;
    std::vector<std::uint32_t> columns;  ///< of the band
    std::vector<CodedBand> sources;      ///< rows of these columns, by reader
    std::size_t heights_at = BandReaders::kNone, left_alone_at = BandReaders::kNone;
    BandReader reader(std::size_t source) const { return reader_of(sources[source]); }
    /// Those of the target (`with_target`); null where it has none.
    const CodedBand* heights() const {
      return heights_at < sources.size() ? &sources[heights_at] : nullptr;
    }
    const CodedBand* left_alone() const {
      return left_alone_at < sources.size() ? &sources[left_alone_at] : nullptr;
    }
  };
  std::vector<Group> groups;

  GroupedBand(const LightMap& map, const PixelBox& band, const BandReaders& readers);
};

/// Joins the columns of groups into rows of a band. Coded bands begin with the last slice.
class Joiner {
 public:
  Joiner(const GroupedBand& band, std::size_t columns, std::vector<CodedBand> coded_bands)
      : band_(band), coded_bands_(std::move(coded_bands)), rows_(columns, 0), part_(columns) {}
  /// Null where the slice is black. Valid until the next call.
  const std::uint8_t* at(int index) {
    bool black = true;
    for (std::size_t g = 0; g < coded_bands_.size(); ++g) {
      black = black && coded_bands_[g].black(index);
      coded_bands_[g].read(index, part_.data());
      const auto& columns = band_.groups[g].columns;
      for (std::size_t k = 0; k < columns.size(); ++k) rows_[columns[k]] = part_[k];
    }
    return black ? nullptr : rows_.data();
  }

 private:
  const GroupedBand& band_;
  std::vector<CodedBand> coded_bands_;
  std::vector<std::uint8_t> rows_, part_;
};

/// Gives the pixel of each column of a group.
inline BandPredictor::PixelOfColumn pixels_of_columns(const PixelBox& band,
                                                      const std::vector<std::uint32_t>& columns) {
  const auto width = static_cast<std::uint32_t>(band.width());
  return [&columns, band, width](std::size_t k) {
    return Pixel{band.x0 + static_cast<int>(columns[k] % width),
                 band.y0 + static_cast<int>(columns[k] / width)};
  };
}

/// Number of columns of each value of light.
using LightCounts = std::array<std::uint64_t, 256>;

/// What all bands print together with the columns that are in none of their groups.
Prediction whole_image(const Prediction& in_groups, const PlaceModels& models, const Grid& grid,
                       int slices, const LightCounts& in_all_groups,
                       const ShownSlices* recorded = nullptr);

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
