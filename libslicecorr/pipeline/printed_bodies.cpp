// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "pipeline/printed_bodies.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

#include "bands/bands.hpp"
#include "base/tile_kernels.hpp"
#include "correct/coverage.hpp"
#include "parallel/silent.hpp"
#include "predict/gel_step.hpp"
#include "slicecorr/error.hpp"

namespace slicecorr::detail {

PrintedBodies::PrintedBodies(const std::vector<PixelBox>& bands, int layers, const CureModel& model,
                             const ExecutionContext& context, bool in_time)
    : layers_(layers),
      step_(gel_step(model)),
      context_(context),
      kept_(bands, layers, context),
      printed_(bands.size()),
      designed_other_(bands.size()),
      whole_other_(bands.size()),
      moments_(bands.size()),
      in_time_(in_time) {}

PrintedBodies::Band::Band(PrintedBodies& whole, std::size_t index, const PixelBox& box)
    : whole_(whole), index_(index), state_(columns_of(box), 0), changes_(columns_of(box)) {}

void PrintedBodies::Band::enter(std::size_t column, int slice, std::uint8_t state) {
  const auto changed = static_cast<std::uint8_t>(state ^ state_[column]);
  if (changed == 0) return;
  changes_.flip(slice + 1, column, changed);
  state_[column] = state;
}

void PrintedBodies::Band::gel(std::size_t column, int slice, int delay) {
  if (told_.empty()) told_.resize(state_.size(), 0);
  // What was told of the slices above begins with them, from the platform on.
  const int above = std::exchange(told_[column], delay), begin = slice + 1;
  const int later = above < 0 ? -1 - above - begin : above;
  moments_.add(begin, column, std::min(later, BodyTracker::kLongestDelay), above < 0);
  if (in_groups_ || !moments_.many()) return;
  // Columns are told tile by tile: of the slices of a tile, in no order.
  kept_moments_.push_back(
      whole_.kept_.keep(moments_.code_above(whole_.layers_, kTileSlices), true));
}

void PrintedBodies::Band::listen(BandPredictor& predictor,
                                 const std::vector<std::uint32_t>* columns) {
  in_groups_ = in_groups_ || columns;
  const auto delays = [this, columns](std::size_t k, int slice, int delay) {
    gel(columns ? (*columns)[k] : k, slice, delay);
    return true;
  };
  if (whole_.in_time_ && !predictor.tell_delays(delays, BodyTracker::kLongestDelay)) {
    whole_.in_time_ = false;
  }
  predictor.tell_states([this, columns](std::size_t k, int slice, std::uint8_t coverage,
                                        bool prints, bool prints_above) {
    const std::size_t column = columns ? (*columns)[k] : k;
    // What is left alone is designed to be what it prints.
    const bool alone = coverage == kLeftAlone && prints;
    const bool designed = alone || coverage > kLeftAlone, whole = alone || coverage == kFull;
    const auto state = [&](bool printed) {
      return static_cast<std::uint8_t>((printed ? kPrinted : 0) |
                                       (designed != printed ? kDesignedOther : 0) |
                                       (whole != printed ? kWholeOther : 0));
    };
    enter(column, slice, state(prints));
    if (prints != prints_above) enter(column, slice - 1, state(prints_above));
  });
}

void PrintedBodies::Band::finish() {
  for (std::size_t column = 0; column < state_.size(); ++column) enter(column, -1, 0);
  for (std::size_t column = 0; column < told_.size(); ++column) {
    if (told_[column] != 0) gel(column, -1, 0);
  }
  told_ = {};
  KeptVoxels::Pieces& pieces = whole_.moments_[index_];
  kept_moments_.push_back(whole_.kept_.keep(moments_.code(whole_.layers_), true));
  for (; !kept_moments_.empty(); kept_moments_.pop_back()) {
    pieces.insert(pieces.end(), kept_moments_.back().begin(), kept_moments_.back().end());
  }
  const auto keep = [&](unsigned kind, KeptVoxels::Stream& to) {
    to[index_] = whole_.kept_.keep(changes_.code(whole_.layers_, kind));
  };
  keep(kPrinted, whole_.printed_);
  keep(kDesignedOther, whole_.designed_other_);
  keep(kWholeOther, whole_.whole_other_);
}

std::shared_ptr<const JudgedBodies> PrintedBodies::judge(const Grid& grid, const ImageFrame& frame,
                                                         const LayerHeights& heights,
                                                         double least_neck_mm2) const {
  auto judged = std::make_shared<JudgedBodies>();
  const auto any = [](const KeptVoxels::Stream& stream) {
    return std::ranges::any_of(stream, [](const auto& pieces) { return !pieces.empty(); });
  };
  const bool delayed = in_time_ && any(moments_);
  const bool designed_alike = !any(designed_other_);
  parallel_for(silent(context_), "", 2, [&](std::size_t i) {
    if (i == 0) {
      judged->printed = kept_.follow({printed_, nullptr, delayed ? &moments_ : nullptr}, grid,
                                     frame, {true, least_neck_mm2, delayed ? step_ : 1});
      judged->printed.in_time = in_time_;
    } else if (!designed_alike || delayed) {
      judged->designed = kept_.follow({printed_, &designed_other_}, grid, frame, {false, 0});
    }
  });
  // What prints as designed hangs together in the end, but not from slice to slice.
  if (designed_alike && !delayed) judged->designed = judged->printed;
  // Only what prints loose though the design joins it may hang by voxels that are covered in part.
  if (judged->printed.loose_bodies > judged->designed.loose_bodies) {
    judged->loose_whole =
        kept_.follow({printed_, &whole_other_}, grid, frame, {false, 0}).loose_bodies;
  }
  judged->printed.heights = judged->designed.heights = heights;
  return judged;
}

void judge_bodies(const JudgedBodies& bodies, const Setup& setup, const ExecutionContext& context) {
  const std::vector<std::string> words = bodies_in_words(bodies);
  if (setup.refuse_loose && bodies.any_loose()) {
    throw InfeasibleError(words.front());
  }
  for (const std::string& sentence : words) context.tell(sentence);
}

}  // namespace slicecorr::detail
