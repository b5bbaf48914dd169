// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>

#include "base/coded_band.hpp"
#include "base/kernels.hpp"
#include "predict/band_state.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/predict.hpp"

namespace slicecorr {

using detail::kLanes;
using detail::kTileSlices;
using detail::LaneMask;

static_assert(BandPredictor::kTileColumns == kLanes);

namespace {

/// Lanes of each slice of a tile.
struct TileMasks {
  LaneMask gaps[kTileSlices], runs[kTileSlices];
  LaneMask changed[kTileSlices];  ///< their light differs from that in the slice before
};

/// `pixels`: null when all is dark.
void read_masks(const std::uint8_t* pixels, const std::uint8_t* coverage, int slices,
                TileMasks& masks) {
  const auto same_rows = [&](const std::uint8_t* rows) {
    return std::memcmp(rows, rows + kLanes, static_cast<std::size_t>(slices - 1) * kLanes) == 0;
  };
  const bool still_design = same_rows(coverage);
  detail::tile_classes(coverage, kLanes, still_design ? 1 : slices, masks.gaps, masks.runs);
  if (still_design) {
    std::fill_n(masks.gaps + 1, slices - 1, masks.gaps[0]);
    std::fill_n(masks.runs + 1, slices - 1, masks.runs[0]);
  }
  if (pixels && !(still_design && (pixels == coverage || same_rows(pixels)))) {
    LaneMask unused[kTileSlices];
    detail::tile_changes(pixels + kLanes, kLanes, slices - 1, unused, masks.changed);
  } else {
    std::fill_n(masks.changed, slices, LaneMask{0});
  }
}

/// What a slice adds to the dose of each lane, at its upper node and at mid-layer.
struct LaneLight {
  alignas(64) double add[kLanes] = {}, add_middle[kLanes] = {};

  void set(std::size_t i, double phi, const CureModel& model) {
    add[i] = phi * model.one_minus_a;
    add_middle[i] = phi * (1.0 - model.root_a);
  }
  /// Of a row of pixels.
  void set_row(const std::uint8_t* row, std::size_t columns, const double* curve,
               const CureModel& model) {
    set(0, curve[row[0]], model);
    if (std::memcmp(row, row + 1, columns - 1) == 0) {
      std::fill_n(add + 1, columns - 1, add[0]);
      std::fill_n(add_middle + 1, columns - 1, add_middle[0]);
    } else {
      for (std::size_t i = 1; i < columns; ++i) set(i, curve[row[i]], model);
    }
  }
};

/// Lanes whose column has been in a run, and in a gap.
struct LaneClasses {
  LaneMask run = 0, gap = 0;
};

/// Of `classes`, a byte for each column: `run_class`, or 0 for a gap.
LaneClasses lane_classes(const std::uint8_t* classes, std::size_t columns, std::uint8_t run_class) {
  LaneClasses was;
  for (std::size_t i = 0; i < columns; i += 8) {
    const std::size_t some = std::min<std::size_t>(8, columns - i);
    std::uint64_t eight = ~std::uint64_t{0};
    std::memcpy(&eight, classes + i, some);
    if (eight == 0) {
      was.gap |= LaneMask{0xFF} << i;
      continue;
    }
    for (std::size_t j = i; j < i + some; ++j) {
      was.run |= static_cast<LaneMask>(classes[j] == run_class) << j;
      was.gap |= static_cast<LaneMask>(classes[j] == 0) << j;
    }
  }
  return was;
}

}  // namespace

/// A slice of a tile, with the lanes in which more happens than counts.
struct BandPredictor::State::TileSlice {
  std::size_t first_column;
  int n;
  const std::uint8_t *cover, *shown;                  ///< rows; shown: null when it is dark
  const std::uint8_t *lower_heights, *upper_heights;  ///< edge heights of its nodes; null: none
  LaneMask grey, entered, crosses;  ///< lanes in grey, in another class than before, at dose 1
  const double *below, *upper, *add_middle;
};

void BandPredictor::State::add_lanes(const TileSlice& s) {
  const LaneMask events = s.entered | s.crosses;
  for (LaneMask m = events | s.grey; m; m &= m - 1) {
    const auto i = static_cast<std::size_t>(std::countr_zero(m));
    // The dose has no jump at nodes.
    const double below = s.below[i], upper = s.upper[i];
    const double middle = s.add_middle[i] + model_.root_a * below;
    if (!(events >> i & 1)) {
      ++prediction_.grey_voxels;
      if (histograms_) prediction_.grey_dose_error.add(std::abs(middle - s.cover[i] / 255.0));
      if (state_sink_) {
        state_sink_(s.first_column + i, s.n, s.cover[i], middle >= 1.0, upper >= 1.0);
      }
      continue;
    }
    double crossing = 0.0;
    const bool passes = s.crosses >> i & 1;
    if (passes) crossing = model_.crossing(s.shown ? curve_[s.shown[i]] : 0.0, below);
    event(s.first_column + i, s.n, below, {below, middle, upper, std::min(below, upper)},
          {&crossing, passes ? std::size_t{1} : std::size_t{0}}, s.cover[i],
          {s.lower_heights ? s.lower_heights[i] : std::uint8_t{0},
           s.upper_heights ? s.upper_heights[i] : std::uint8_t{0}});
  }
}

void BandPredictor::State::add_tile(const TilePlace& place, const std::uint8_t* pixels,
                                    const DesignRow& design) {
  if (dose_) throw Error("only plain models are predicted in tiles");
  const std::size_t first_column = place.first_column, columns = place.columns;
  const std::uint8_t *const coverage = design.coverage, *const heights = design.heights;
  const int first_slice = place.first_slice;
  int slices = place.slices;
  while (slices > kTileSlices) {
    const auto skip = static_cast<std::size_t>(slices - kTileSlices) * kLanes;
    add_tile({first_column, columns, first_slice + slices - kTileSlices, kTileSlices},
             pixels ? pixels + skip : nullptr,
             {coverage + skip, heights ? heights + skip : nullptr});
    slices -= kTileSlices;
  }
  if (slices <= 0) return;
  for (int k = slices; moments_ && pixels && k-- > 0;) {
    moments_->add_slice(first_slice + k, first_column, columns,
                        pixels + static_cast<std::size_t>(k) * kLanes);
  }
  if (!tile_sums_) tile_sums_ = std::make_unique<detail::TileSums>();
  detail::TileSums& sums = *tile_sums_;

  TileMasks masks;
  read_masks(pixels, coverage, slices, masks);
  // Lanes past the last column never have light, and are neither a gap nor a run.
  const LaneMask valid = columns < kLanes ? (LaneMask{1} << columns) - 1 : ~LaneMask{0};

  LaneLight light;
  if (pixels) {
    light.set_row(pixels + static_cast<std::size_t>(slices - 1) * kLanes, columns, curve_.data(),
                  model_);
  }
  double* const omega = &omega_[first_column];
  alignas(64) double dose[2][kLanes], ahead[kLanes];
  detail::copy_lanes(omega, dose[0]);
  int now = 0;
  static_assert(gap == 0 && run == 1 && grey == 2);
  const LaneClasses first =
      lane_classes(reinterpret_cast<const std::uint8_t*>(&class_[first_column]), columns, run);
  LaneMask was_run = first.run, was_gap = first.gap;
  detail::PredictStep step{model_.a,
                           model_.root_a,
                           light.add,
                           light.add_middle,
                           nullptr,
                           0,
                           0,
                           0,
                           nullptr,
                           sums.inside_low,
                           sums.inside_high,
                           sums.outside_high,
                           &least_[first_column]};
  LaneMask printed = detail::printed_lanes(dose[0]);
  for (int k = slices; k-- > 0;) {
    const int n = first_slice + k;
    const std::uint8_t* const cover = coverage + static_cast<std::size_t>(k) * kLanes;
    if (k + 1 < slices) {
      const std::uint8_t* const row = pixels + static_cast<std::size_t>(k) * kLanes;
      for (LaneMask m = masks.changed[k] & valid; m; m &= m - 1) {
        const auto i = static_cast<std::size_t>(std::countr_zero(m));
        light.set(i, curve_[row[i]], model_);
      }
    }
    const LaneMask in_run = masks.runs[k] & valid, in_gap = masks.gaps[k] & valid;
    const LaneMask grey_lanes = valid & ~in_run & ~in_gap;
    step.from = dose[now];
    step.to = dose[1 - now];
    step.run = in_run;
    step.gap = in_gap;
    step.stays = (in_run & was_run) | (in_gap & was_gap);
    const std::uint8_t* const upper_heights =
        heights ? heights + static_cast<std::size_t>(k) * kLanes : nullptr;
    if (upper_heights && prediction_.at_heights && !detail::all_zero(upper_heights, kLanes)) {
      for (std::size_t i = 0; i < kLanes; ++i) {
        if (ends_inside(upper_heights[i])) step.stays &= ~(LaneMask{1} << i);
      }
    }
    const detail::PrintedLanes is = detail::predict_lanes(step);
    const auto count = [&](int times) {
      sums.run_voxels += static_cast<std::uint64_t>(times) * static_cast<unsigned>(is.run);
      sums.run_printed += static_cast<std::uint64_t>(times) * static_cast<unsigned>(is.in_run);
      sums.gap_printed += static_cast<std::uint64_t>(times) * static_cast<unsigned>(is.in_gap);
    };
    count(1);
    const LaneMask entered = ((in_run ^ was_run) | (in_gap ^ was_gap)) & valid;
    const LaneMask crosses = (is.node ^ printed) & valid;
    if ((entered | crosses | grey_lanes) != 0) {
      const std::uint8_t* lower_heights = &lower_heights_[first_column];
      if (k + 1 < slices) {
        lower_heights = heights ? heights + static_cast<std::size_t>(k + 1) * kLanes : nullptr;
      }
      add_lanes({first_column, n, cover, pixels ? pixels + (cover - coverage) : nullptr,
                 lower_heights, upper_heights, grey_lanes, entered, crosses, dose[now],
                 dose[1 - now], light.add_middle});
    }
    was_run = in_run;
    was_gap = in_gap;
    printed = is.node;
    now = 1 - now;

    // A stretch in which no light and no coverage changes. Doses of a lane that gets the same light
    // all the time rise or fall throughout, rounding does not change that: what holds for its ends
    // holds between them.
    int more = 0;
    while (more < k && grey_lanes == 0 && ((masks.changed[k - 1 - more] & valid) == 0) &&
           (masks.runs[k - 1 - more] & valid) == in_run &&
           (masks.gaps[k - 1 - more] & valid) == in_gap) {
      ++more;
    }
    if (more < 2) continue;
    detail::copy_lanes(dose[now], ahead);
    detail::step_lanes(light.add, model_.a, ahead, more - 1);
    if (detail::printed_lanes(ahead) != printed) continue;
    step.from = ahead;
    step.to = dose[now];
    step.stays = in_run | in_gap;
    if (!detail::prints_alike(step, is)) continue;
    detail::predict_lanes(step);
    count(more);
    k -= more;
  }
  std::memcpy(&lower_heights_[first_column], heights ? heights : empty_.data(), kLanes);
  detail::copy_lanes(dose[now], omega);
  for (LaneMask m = (was_run ^ first.run) | (was_gap ^ first.gap); m; m &= m - 1) {
    const auto i = static_cast<std::size_t>(std::countr_zero(m));
    class_[first_column + i] = was_run >> i & 1 ? run : was_gap >> i & 1 ? gap : grey;
  }
  for (std::size_t b = first_column / detail::kBlock;
       b < block_class_.size() && b * detail::kBlock < first_column + kLanes; ++b)
    block_class_[b] = grey;
}

}  // namespace slicecorr
