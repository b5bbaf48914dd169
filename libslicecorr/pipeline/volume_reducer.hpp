// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Gathers a ReducedVolume from predictions of bands, while they are made.
#pragma once

#include <functional>
#include <mutex>
#include <span>
#include <utility>
#include <vector>

#include "slicecorr/place_models.hpp"
#include "slicecorr/predict.hpp"
#include "slicecorr/volume.hpp"

namespace slicecorr::detail {

/// How well a pixel stands for its cells; greater is better.
struct CellRank {
  std::int64_t wrong_after = -1, wrong_before = -1, off_middle = 0;
  auto operator<=>(const CellRank&) const = default;  // NOLINT: no 0 is a pointer here
};

/// Bands may be gathered on different threads and in any order, and give the same volume.
class VolumeReducer {
 public:
  /// `target_layers` and `stack_layers`: slices that each of the two shows. `levels`: grey levels
  /// of the printer. `models` must outlive this.
  VolumeReducer(const PlaceModels& models, const PixelBox& box, int target_layers, int stack_layers,
                int levels, int most_cells);

  /// Gathers one band; for one thread.
  class Band;
  /// Light of columns that get it from others is kept, too, but not under UV light. Before the first
  /// band. `model`: of that light (`SpreadLight::model`); must outlive this.
  void keep_light(const CureModel& model) {
    of_light_ = &model;
    volume_.under_uv = model.inhibited() != nullptr;
    if (volume_.under_uv) return;
    // Beyond the display's edge light fades, and what scatters adds to it.
    volume_.least_light = model.phi_min() / 16;
    volume_.greatest_light = 2 * model.phi_max();
  }

  /// The volume; to be called after all bands, which must cover the box.
  ReducedVolume take() { return std::move(volume_); }

 private:
  std::size_t cell(int i, int j, int k) const {
    return (static_cast<std::size_t>(k) * static_cast<std::size_t>(volume_.ny) +
            static_cast<std::size_t>(j)) *
               static_cast<std::size_t>(volume_.nx) +
           static_cast<std::size_t>(i);
  }

  /// The cells of a row of columns. Their voxels are counted only until all bands that reach into
  /// the row have joined it; then flags say what is kept of the counts.
  struct CellRow {
    std::mutex mutex;
    int pixel_rows_left = 0;
    /// Voxels by column and height of cells. One cell has fewer than 2^32 of them.
    std::vector<std::uint32_t> designed, printed_before, printed_after;
  };
  std::uint32_t light_code(double phi) const;
  /// Makes flags of the counts of row `j`.
  void settle(int j);

  const PlaceModels& models_;
  const CureModel* of_light_ = nullptr;  ///< see keep_light
  int target_layers_, stack_layers_, levels_;
  ReducedVolume volume_;
  std::vector<CellRank> ranks_;            ///< of the columns that stand so far
  std::vector<std::uint32_t> cell_layer_;  ///< of each slice
  std::vector<CellRow> rows_;
};

class VolumeReducer::Band {
 public:
  Band(VolumeReducer& volume, const PixelBox& band);

  /// Lets a predictor tell this band what it finds. `columns`: those of the band that are the
  /// predictor's, null for all; must outlive the predictor.
  void listen_before(BandPredictor& predictor, const std::vector<std::uint32_t>* columns) {
    listen(predictor, columns, before_);
  }
  void listen_after(BandPredictor& predictor, const std::vector<std::uint32_t>* columns) {
    listen(predictor, columns, after_);
  }

  /// Writes the band's pixels of a slice; black beyond its last.
  using Reader = std::function<void(int slice, std::uint8_t* pixels)>;
  /// The light of each slice over the chosen columns, where light spreads; see SpreadBand.
  using Light = std::function<std::span<const ImageShowing>(int slice)>;
  /// Makes these of the target shown as it is and of the stack.
  using Lights = std::function<std::pair<Light, Light>(const std::vector<Pixel>& places)>;
  /// Joins the band into the volume; to be called once, after all predictors. `lights`: null where
  /// light stays in its column.
  void finish(const Reader& shown, const Reader& design, const Lights& lights = {});

 private:
  /// Voxels of the band's cells. Columns have runs of many slices: the cells that a run fills are
  /// noted by where they begin and end.
  struct Counts {
    std::vector<std::uint32_t> partly, filled;
    void add(const VolumeReducer& volume, std::size_t column, int low, int high);
    /// Turns the noted beginnings and ends into counts per cell.
    void sum(std::size_t column, int nz, std::uint32_t step);
  };
  struct Print {
    std::vector<std::uint8_t> state;    ///< per column: that of the slices at hand
    std::vector<std::int32_t> highest;  ///< per column: slices up to this one are not counted yet
    std::vector<std::uint32_t> wrong;   ///< per column: wrong voxels
    Counts printed;
    std::vector<std::uint8_t> flags, error;  ///< per cell
  };
  struct Chosen {
    std::size_t at = 0;  ///< column of the band
    int i = 0, j = 0;
    CellRank rank;
    ReducedVolume::Column column;
    std::vector<std::uint8_t> dose_before, dose_after, grey_before, grey_after;
  };

  void listen(BandPredictor& predictor, const std::vector<std::uint32_t>* columns, Print& print);
  void enter(Print& print, std::size_t column, int slice, std::uint8_t state);
  /// Counts slices from `low` up to where the column's state began.
  void count(Print& print, std::size_t column, int low);
  void mark_error(Print& print, std::size_t column, int node, bool upper, double um) const;
  std::vector<Chosen> choose() const;
  void follow(std::vector<Chosen>& chosen, const Reader& shown, const Reader& design,
              const Lights& lights) const;
  void join(std::vector<Chosen>& chosen);

  VolumeReducer& volume_;
  PixelBox band_;
  int j0_, j1_;  ///< rows of columns of cells, [j0, j1)
  /// Per column: its first cell. Bands may have rows beyond the box.
  static constexpr std::uint32_t kNoCell = 0xFFFFFFFF;
  std::vector<std::uint32_t> cells_;
  Print before_, after_;
  Counts designed_;
};

}  // namespace slicecorr::detail
