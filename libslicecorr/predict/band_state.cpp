// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "predict/band_state.hpp"

#include <algorithm>
#include <cmath>
#include <memory>

#include "base/coded_band.hpp"
#include "base/tile_kernels.hpp"
#include "correct/coverage.hpp"
#include "cure/walkers.hpp"
#include "predict/block_kernels.hpp"
#include "slicecorr/predict.hpp"
#include "slicecorr/target.hpp"

namespace slicecorr {

using detail::BlockSums;
using detail::Factors;
using detail::kBlock;
using detail::one_sided_block;
using detail::take_least;

namespace {

constexpr double kNever = std::numeric_limits<double>::infinity();

std::size_t padded(std::size_t columns) {
  return (columns + detail::kLanes - 1) / detail::kLanes * detail::kLanes;
}

}  // namespace

BandPredictor::State::~State() = default;

BandPredictor::State::State(const CureModel& model, const PixelCurve& curve, int all_layers,
                            std::size_t columns, bool in_showings)
    : model_(model),
      curve_(curve),
      all_layers_(all_layers),
      in_showings_(in_showings),
      omega_(padded(columns), 0.0),
      least_(padded(columns), kNever),
      class_(padded(columns), gap),
      columns_(columns),
      lower_heights_(padded(columns), 0),
      empty_(padded(columns), 0),
      block_class_(padded(columns) / kBlock, gap),
      sums_(std::make_unique<BlockSums>()) {
  for (Column& c : columns_) {
    c.start = all_layers;
    c.lower = all_layers;
  }
  if (in_showings || !model.is_plain()) dose_ = std::make_unique<BandDose>(model, columns);
  if (dose_) inside_.resize(kBlock);
  if (model.lifts) {
    joints_ = std::make_unique<detail::JointWalker>(model, columns);
  }
}

bool BandPredictor::State::tell_delays(DelaySink sink, int longest) {
  if (in_showings_ || !detail::GelMoments::known(model_)) return false;
  moments_ = std::make_unique<detail::GelMoments>(model_, curve_, columns_.size(), longest,
                                                  std::move(sink));
  return true;
}

void BandPredictor::State::error(std::size_t i, int node, std::uint8_t height, bool upper,
                                 double slices) {
  double reach = slices;  // beyond the design's surface
  if (height != 0) {
    const double below = edge_height_slices(height);
    const double from_surface = upper ? slices + below : slices - below;
    if (histograms_) prediction_.surface_error_um.add(std::abs(from_surface * model_.layer_um));
    reach = from_surface;
    // Layer by layer, nothing but the window decides where lower edges lie.
    const bool chosen = upper || model_.mode == ExposureMode::continuous;
    if (prediction_.at_heights && chosen) slices = from_surface;
  }
  if (!sides_.below_um.empty()) {
    // Edges come from the last slice on: the last upper one and the first lower one are seen.
    const auto reach_um = static_cast<float>(reach * model_.layer_um);
    if (upper) {
      sides_.below_um[i] = reach_um;
    } else if (std::isnan(sides_.above_um[i])) {
      sides_.above_um[i] = reach_um;
    }
  }
  const double um = slices * model_.layer_um;
  if (edge_sink_) edge_sink_(i, node, upper, um);
  const double size = std::abs(um);
  if (histograms_) prediction_.height_error_um.add(size);
  if (um > 0) {
    prediction_.greatest_overreach_um = std::max(prediction_.greatest_overreach_um, um);
  } else {
    prediction_.greatest_shortfall_um = std::max(prediction_.greatest_shortfall_um, -um);
  }
  if (size > worst_ || (size == worst_ && i < worst_column_)) {
    worst_ = size;
    worst_column_ = i;
  }
}

void BandPredictor::State::lose(std::size_t i, int top) {
  const Column& c = columns_[i];
  ++prediction_.runs;
  if (run_sink_) run_sink_(i, top, c.lower - 1, !c.any_printed, c.split);
  if (c.split) {
    ++prediction_.split_features;
    split_.add({0, static_cast<int>(i), top, c.lower - 1});
  }
  if (c.any_printed) return;
  lost_.add({0, static_cast<int>(i), top, c.lower - 1});
  ++prediction_.lost_features;
  if (c.lower - top >= 2) ++prediction_.lost_thick_features;
}

/// Takes up the least dose of the run, or of its present piece, which ends here.
void BandPredictor::State::leave_stretch(std::size_t i) {
  prediction_.min_inside_layers = std::min(prediction_.min_inside_layers, least_[i]);
  least_[i] = kNever;
}

void BandPredictor::State::close_gap(std::size_t i, int top) {
  Column& c = columns_[i];
  if (c.run_below && c.gap_seen) {
    ++prediction_.gaps;
    prediction_.one_slice_gaps += c.gap_layers == 1;
    if (histograms_) prediction_.gap_contrast.add(std::max(0.0, 1.0 - least_[i]));
    if (gap_sink_) gap_sink_(i, top, c.gap_end - 1, least_[i]);
    if (least_[i] >= 1.0) {
      ++prediction_.merged_features;
      merged_.add({0, static_cast<int>(i), top, c.gap_end - 1});
      if (c.gap_layers >= 2) ++prediction_.merged_thick_gaps;
    }
  }
}

void BandPredictor::State::enter(std::size_t i, int node, std::uint8_t height, Class next,
                                 double before, double after) {
  Column& c = columns_[i];
  const bool printed_before = before >= 1.0, printed = after >= 1.0;
  const Class old = class_[i];
  if (old == gap) look_at_last(i);
  if (old == run) {
    if (c.seeks_print) error(i, c.lower, c.lower_height, false, -between(node, c.lower));
    c.seeks_print = false;
    lose(i, node);
    if (next == gap) {
      if (printed) {
        c.seeks_end = true;
      } else {
        // Seen from the edge, the print begins where the unprinted stretch beside the edge ends.
        error(i, node, height, true,
              printed_before ? 0.0 : -between(node, c.any_printed ? c.start : c.lower));
      }
    }
    c.run_below = true;
    c.gap_end = node;
    c.gap_seen = false;
    c.gap_layers = 0;
    leave_stretch(i);
  } else if (old == gap) {
    c.gap_layers += c.lower - node;
    if (c.seeks_end) error(i, c.lower, c.lower_height, true, between(node, c.lower));
    c.seeks_end = false;
    if (next == run) {
      if (printed_before) {
        error(i, node, height, false, between(node, std::min<double>(c.start, c.lower)));
      } else if (printed) {
        error(i, node, height, false, 0.0);
      } else {
        c.seeks_print = true;
      }
    }
  }
  c.tooth = false;
  if (next == run) {
    close_gap(i, node);
    least_[i] = kNever;
    c.any_printed = printed;
    c.split = false;
  } else if (next == gap) {
    c.gap_seen = true;
  }
  if (printed != printed_before) c.start = node;
  c.lower = node;
  c.lower_height = height;
  class_[i] = next;
}

void BandPredictor::State::cross(std::size_t i, double zeta, bool printed, Class now) {
  Column& c = columns_[i];
  c.start = zeta;
  if (printed) {
    if (now == run) {
      if (c.any_printed && least_[i] < 1.0 - kSameDose) c.split = true;
      leave_stretch(i);
      c.any_printed = true;
      if (c.seeks_print) error(i, c.lower, c.lower_height, false, -between(c.start, c.lower));
      c.seeks_print = false;
    }
    c.tooth = now == gap && c.run_below;
    return;
  }
  if (c.seeks_end) {
    error(i, c.lower, c.lower_height, true, between(c.start, c.lower));
    c.seeks_end = false;
  }
  if (c.tooth && now == gap) ++prediction_.gap_teeth;
  c.tooth = false;
}

void BandPredictor::State::event(std::size_t i, int slice, double below, LayerDose dose,
                                 std::span<const double> crossings, std::uint8_t coverage,
                                 NodeHeights heights) {
  const Class now = coverage == 0 ? gap : coverage == 255 ? run : grey;
  // Between an edge inside the layer and its node lies nothing of the feature.
  const bool no_upper = now == run && ends_inside(heights.upper);
  const bool no_lower =
      now == run && prediction_.at_heights && heights.lower != 0 && heights.lower < kEdgeAtNode;
  if (no_upper || no_lower) {
    dose.least = dose.middle;
    if (!no_upper) dose.least = std::min(dose.least, dose.upper);
    if (!no_lower) dose.least = std::min(dose.least, dose.lower);
  }
  if (state_sink_) state_sink_(i, slice, coverage, dose.middle >= 1.0, dose.upper >= 1.0);
  bool printed = dose.lower >= 1.0;
  if (now != class_[i]) {
    enter(i, slice + 1, heights.lower, now, below, dose.lower);
  } else if ((below >= 1.0) != printed) {
    cross(i, slice + 1, printed, now);
  }
  for (const double crossing : crossings) {
    if (now != grey) least_[i] = std::min(least_[i], dose.least);
    printed = !printed;
    cross(i, slice + 1 - crossing, printed, now);
  }
  if (now != grey) {
    // Where print came back in this layer, its new piece has nothing of the lower doses before.
    const bool back = now == run && !crossings.empty() && printed;
    least_[i] = std::min(least_[i], back ? dose.upper : dose.least);
  } else if (left_alone_ && left_alone_[i]) {
    ++prediction_.left_alone_voxels;
  } else {
    ++prediction_.grey_voxels;
    if (histograms_) {
      prediction_.grey_dose_error.add(std::abs(dose.middle - coverage / 255.0));
    }
  }
}

void BandPredictor::State::add_slice(int slice, const std::uint8_t* pixels,
                                     const DesignRow& design) {
  if (!pixels) return add_slice(slice, std::span<const ImageShowing>{}, design);
  const int setting = model_.inhibited() ? model_.inhibited()->setting_of_slice(slice) : 0;
  const ImageShowing whole{pixels, 1.0, setting};
  add_slice(slice, {&whole, 1}, design);
}

void BandPredictor::State::add_slice(int slice, std::span<const ImageShowing> showings,
                                     const DesignRow& design) {
  DesignRow judged(design.coverage ? design.coverage : empty_.data(), design.heights);
  left_alone_ = design.left_alone;
  if (left_alone_) {
    // A grey that aims at nothing: it is neither a feature nor a gap.
    with_left_alone_.assign(judged.coverage, judged.coverage + columns_.size());
    for (std::size_t i = 0; i < columns_.size(); ++i) {
      if (left_alone_[i]) with_left_alone_[i] = detail::kLeftAlone;
    }
    judged.coverage = with_left_alone_.data();
  }
  if (joints_) joints_->add_slice(slice, showings, judged, prediction_.at_heights);
  if (moments_) {
    moments_->add_slice(slice, 0, columns_.size(),
                        showings.empty() ? nullptr : showings.front().pixels);
  }
  if (dose_) {
    add_general_slice(slice, showings, judged.coverage, judged.heights);
  } else {
    add_plain_slice(slice, showings, judged.coverage, judged.heights);
  }
  std::copy_n(judged.heights ? judged.heights : empty_.data(), columns_.size(),
              lower_heights_.begin());
}

const std::uint8_t* BandPredictor::State::classes_of_block(std::size_t b, std::size_t n,
                                                           const std::uint8_t* heights,
                                                           std::uint8_t* room) const {
  const auto* const classes = reinterpret_cast<const std::uint8_t*>(&class_[b]);
  if (!heights || !prediction_.at_heights || detail::all_zero(heights + b, n)) return classes;
  std::copy_n(classes, kBlock, room);
  for (std::size_t i = 0; i < n; ++i) {
    if (ends_inside(heights[b + i])) room[i] = grey;
  }
  return room;
}

void BandPredictor::State::add_general_slice(int slice, std::span<const ImageShowing> showings,
                                             const std::uint8_t* cover,
                                             const std::uint8_t* heights) {
  dose_->add_slice(slice, showings);
  BlockSums& sums = *sums_;
  std::uint8_t events[kBlock], tail_cover[kBlock], classes[kBlock];
  double tail[3][kBlock];
  for (std::size_t b = 0; b < columns_.size(); b += kBlock) {
    const std::size_t n = std::min(kBlock, columns_.size() - b);
    const double* lower_dose = dose_->lower() + b;
    const double* middle = dose_->middle() + b;
    const double* upper = dose_->upper() + b;
    const std::uint8_t* block_cover = cover + b;
    if (n < kBlock) {
      // The lanes past the last column stay in a gap of no light; see finish().
      std::fill(std::copy_n(block_cover, n, tail_cover), tail_cover + kBlock, std::uint8_t{0});
      block_cover = tail_cover;
      for (std::size_t k = 0; k < 3; ++k) {
        const double*& dose = k == 0 ? lower_dose : k == 1 ? middle : upper;
        std::fill(std::copy_n(dose, n, tail[k]), tail[k] + kBlock, 0.0);
        dose = tail[k];
      }
    }
    look_inside(slice, b, n, block_cover);
    const auto looked = [&](std::size_t i) { return (looked_ >> i & 1) != 0; };
    const auto keep_least = [&] {
      for (const double* dose : {lower_dose, middle, upper}) take_least(&least_[b], dose);
      for (std::size_t i = 0; i < n; ++i) {
        if (looked(i)) least_[b + i] = std::min(least_[b + i], inside_[i].least);
      }
      std::copy_n(upper, kBlock, &omega_[b]);
    };
    Class& block = block_class_[b / kBlock];
    if (block != grey && !passes_inside_) {
      const detail::BlockBits bits = detail::block_bits(block_cover);
      if (block == gap && bits.any == 0) {
        if (one_sided_block(&omega_[b], lower_dose, middle, upper, sums.outside_low,
                            sums.outside_high, true)) {
          keep_least();
          continue;
        }
      } else if (block == run && bits.all == ~std::uint64_t{0}) {
        if (one_sided_block(&omega_[b], lower_dose, middle, upper, sums.inside_low,
                            sums.inside_high, false)) {
          keep_least();
          prediction_.target_voxels += kBlock;
          prediction_.printed_voxels += kBlock;
          continue;
        }
      }
    }
    mixed_known_block(&omega_[b], lower_dose, middle, upper, block_cover,
                      classes_of_block(b, n, heights, classes), &least_[b], sums, events);
    for (std::size_t i = 0; i < n; ++i) {
      InsideLayer& inside = inside_[i];
      if (!events[i]) {
        if (!looked(i)) continue;
        if (inside.crossings.empty()) {
          least_[b + i] = std::min(least_[b + i], inside.least);
          continue;
        }
      }
      // Where the dose does not turn inside the layer, only its crossing is to be found.
      if (!looked(i)) {
        inside.crossings.clear();
        inside.least = std::min({lower_dose[i], middle[i], upper[i]});
        if ((lower_dose[i] >= 1.0) != (upper[i] >= 1.0)) dose_->inside(b + i, -kNever, inside);
      }
      event(b + i, slice, omega_[b + i], {lower_dose[i], middle[i], upper[i], inside.least},
            inside.crossings, block_cover[i],
            {lower_heights_[b + i], heights ? heights[b + i] : std::uint8_t{0}});
    }
    std::copy_n(upper, kBlock, &omega_[b]);
    const bool one_class = detail::uniform(reinterpret_cast<const std::uint8_t*>(&class_[b]));
    block = one_class ? class_[b] : grey;
  }
}

void BandPredictor::State::add_plain_slice(int slice, std::span<const ImageShowing> showings,
                                           const std::uint8_t* cover, const std::uint8_t* heights) {
  const Factors f{model_.a, model_.one_minus_a, model_.root_a, 1.0 - model_.root_a};
  alignas(64) double phi[kBlock];
  alignas(64) double dose[kBlock];
  alignas(64) double middle[kBlock];
  std::uint8_t events[kBlock], classes[kBlock];
  BlockSums& sums = *sums_;
  for (std::size_t b = 0; b < columns_.size(); b += kBlock) {
    const std::size_t n = std::min(kBlock, columns_.size() - b);
    std::uint8_t tail[kBlock];
    const std::uint8_t* block_cover = cover + b;
    if (n < kBlock) {
      // The lanes past the last column stay in a gap of no light; see finish().
      std::fill(std::copy_n(cover + b, n, tail), tail + kBlock, std::uint8_t{0});
      block_cover = tail;
      std::fill_n(phi, kBlock, 0.0);
    }
    detail::block_phi(curve_, showings, b, n, phi);
    // A block inside a gap and unprinted, or inside features and printed, has no events.
    Class& block = block_class_[b / kBlock];
    if (block != grey) {
      const detail::BlockBits bits = detail::block_bits(block_cover);
      if (block == gap && bits.any == 0) {
        if (step_block(f, phi, &omega_[b], dose, sums.outside_low, sums.outside_high, true)) {
          std::copy_n(dose, kBlock, &omega_[b]);
          take_least(&least_[b], dose);
          continue;
        }
      } else if (block == run && bits.all == ~std::uint64_t{0}) {
        if (step_block(f, phi, &omega_[b], dose, sums.inside_low, sums.inside_high, false)) {
          std::copy_n(dose, kBlock, &omega_[b]);
          take_least(&least_[b], dose);
          prediction_.target_voxels += kBlock;
          prediction_.printed_voxels += kBlock;
          continue;
        }
      }
    }
    mixed_block(f, phi, &omega_[b], dose, middle, block_cover,
                classes_of_block(b, n, heights, classes), &least_[b], sums, events);
    for (std::size_t i = 0; i < n; ++i) {
      if (!events[i]) continue;
      // The dose has no jump at nodes.
      const double below = omega_[b + i];
      const bool crosses = (below >= 1.0) != (dose[i] >= 1.0);
      const double crossing = crosses ? model_.crossing(phi[i], below) : 0.0;
      event(b + i, slice, below, {below, middle[i], dose[i], std::min(below, dose[i])},
            {&crossing, crosses ? std::size_t{1} : std::size_t{0}}, block_cover[i],
            {lower_heights_[b + i], heights ? heights[b + i] : std::uint8_t{0}});
    }
    std::copy_n(dose, kBlock, &omega_[b]);
    // Grey stands for blocks of several classes, too.
    const bool one_class = detail::uniform(reinterpret_cast<const std::uint8_t*>(&class_[b]));
    block = one_class ? class_[b] : grey;
  }
}

void BandPredictor::State::go_on_from(Prediction so_far) {
  const bool at_heights = prediction_.at_heights;
  prediction_ = std::move(so_far);
  prediction_.at_heights = at_heights;
  worst_so_far_ = prediction_.worst_x >= 0 ? prediction_.height_error_um.greatest() : -1.0;
}

void BandPredictor::State::keep_sides() {
  sides_.below_um.assign(columns_.size(), std::numeric_limits<float>::quiet_NaN());
  sides_.above_um = sides_.below_um;
}

Prediction BandPredictor::State::finish(const PixelOfColumn& place) {
  for (std::size_t i = 0; i < kBlock; ++i) {
    Prediction& p = prediction_;
    p.target_voxels += static_cast<std::uint64_t>(sums_->run_voxels[i]);
    p.printed_voxels += static_cast<std::uint64_t>(sums_->run_printed[i] + sums_->gap_printed[i]);
    p.cure_through_voxels += static_cast<std::uint64_t>(sums_->gap_printed[i]);
    p.undercure_voxels += static_cast<std::uint64_t>(sums_->run_voxels[i] - sums_->run_printed[i]);
    p.min_dose_inside = std::min(p.min_dose_inside, sums_->inside_low[i]);
    p.max_dose_inside = std::max(p.max_dose_inside, sums_->inside_high[i]);
    // Dose outside: lanes past the last column give 0, which no real column is below.
    p.max_dose_outside = std::max(p.max_dose_outside, sums_->outside_high[i]);
  }
  if (tile_sums_) tile_sums_->add_to(prediction_);
  for (std::size_t i = 0; i < columns_.size(); ++i) {
    Column& c = columns_[i];
    if (class_[i] == run) {
      if (c.seeks_print) error(i, c.lower, c.lower_height, false, -between(0, c.lower));
      ++prediction_.runs_on_platform;
      prediction_.liquid_at_platform += c.any_printed && omega_[i] < kLeastAtPlatform;
      lose(i, 0);
      leave_stretch(i);
    } else {
      if (class_[i] == gap) {
        if (c.seeks_end) error(i, c.lower, c.lower_height, true, between(0, c.lower));
        c.gap_layers += c.lower;
        look_at_last(i);
      }
      close_gap(i, 0);
    }
  }
  if (joints_) {
    if (!prediction_.joints) prediction_.joints.emplace();
    joints_->finish(*prediction_.joints);
  }
  const auto placed = [&](const FeatureExamples& from, FeatureExamples& to) {
    for (FeatureExample e : from.sorted()) {
      const Pixel at = place(static_cast<std::size_t>(e.y));
      e.x = at.x;
      e.y = at.y;
      to.add(e);
    }
  };
  placed(lost_, prediction_.lost_examples);
  placed(merged_, prediction_.merged_examples);
  placed(split_, prediction_.split_examples);
  if (worst_ >= 0) {
    const Pixel at = place(worst_column_);
    const bool earlier =
        at.y < prediction_.worst_y || (at.y == prediction_.worst_y && at.x < prediction_.worst_x);
    if (worst_ > worst_so_far_ || (worst_ == worst_so_far_ && earlier)) {
      prediction_.worst_x = at.x;
      prediction_.worst_y = at.y;
    }
  }
  return std::move(prediction_);
}

Prediction predict_black_columns(const CureModel& model, int slices, std::uint64_t columns,
                                 const BlackShowings& showings) {
  Prediction p;
  if (columns == 0) return p;
  BandDose dose(model, 1);
  for (int n = slices; n-- > 0;) {
    dose.add_slice(n, showings(n));
    p.max_dose_outside = std::max(p.max_dose_outside, *dose.middle());
  }
  p.black_alone_dose = std::max(0.0, p.max_dose_outside);
  return p;
}

Prediction predict_black_columns(const CureModel& model, int slices, std::uint64_t columns) {
  if (!model.is_plain()) {
    const std::uint8_t black = 0;
    ImageShowing whole{&black, 1.0, 0};
    return predict_black_columns(model, slices, columns, [&](int n) {
      whole.setting = model.inhibited() ? model.inhibited()->setting_of_slice(n) : 0;
      return std::span<const ImageShowing>(&whole, 1);
    });
  }
  Prediction p;
  if (columns == 0) return p;
  double omega = 0;
  for (int n = slices; n-- > 0;) {
    p.max_dose_outside = std::max(p.max_dose_outside, model.middle(model.phi_min(), omega));
    omega = model.step(model.phi_min(), omega);
  }
  p.black_alone_dose = std::max(0.0, p.max_dose_outside);
  return p;
}

}  // namespace slicecorr
