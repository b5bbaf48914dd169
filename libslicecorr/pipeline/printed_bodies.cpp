// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "pipeline/printed_bodies.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <utility>

#include "bands/bands.hpp"
#include "correct/coverage.hpp"
#include "parallel/silent.hpp"
#include "slicecorr/error.hpp"

namespace slicecorr::detail {

PrintedBodies::PrintedBodies(const std::vector<PixelBox>& bands, int layers,
                             const ExecutionContext& context)
    : layers_(layers),
      context_(context),
      kept_(bands, layers, context),
      printed_(bands.size()),
      designed_other_(bands.size()),
      whole_other_(bands.size()),
      delays_(std::bit_width(static_cast<unsigned>(BodyTracker::kLongestDelay)),
              KeptVoxels::Stream(bands.size())) {}

PrintedBodies::Band::Band(PrintedBodies& whole, std::size_t index, const PixelBox& box)
    : whole_(whole), index_(index), state_(columns_of(box), 0), changes_(columns_of(box)) {}

void PrintedBodies::Band::enter(std::size_t column, int slice, std::uint8_t state) {
  const auto changed = static_cast<std::uint8_t>(state ^ state_[column]);
  if (changed == 0) return;
  changes_.flip(slice + 1, column, changed);
  state_[column] = state;
}

bool PrintedBodies::Band::gel(std::size_t column, int slice, int delay) {
  if (!whole_.in_time_) return false;
  if (++whole_.moments_ > kMostMoments) {
    whole_.in_time_ = false;
    return false;
  }
  set_delay(column, slice, delay);
  return true;
}

void PrintedBodies::Band::set_delay(std::size_t column, int slice, int delay) {
  if (delay_.empty()) delay_.resize(state_.size(), 0);
  const unsigned changed = delay_[column] ^ static_cast<unsigned>(delay);
  for (unsigned bits = changed, k = 0; bits != 0; bits >>= VoxelChanges::kKinds, ++k) {
    const unsigned kinds = bits & ((1U << VoxelChanges::kKinds) - 1);
    while (delays_.size() <= k) delays_.emplace_back(state_.size());
    if (kinds != 0) delays_[k].flip(slice + 1, column, kinds);
  }
  delay_[column] = static_cast<std::uint16_t>(delay);
}

void PrintedBodies::Band::listen(BandPredictor& predictor,
                                 const std::vector<std::uint32_t>* columns) {
  const bool in_time = predictor.tell_delays(
      [this, columns](std::size_t k, int slice, int delay) {
        return gel(columns ? (*columns)[k] : k, slice, delay);
      },
      BodyTracker::kLongestDelay);
  if (!in_time) whole_.in_time_ = false;
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
  for (std::size_t column = 0; whole_.in_time_ && column < delay_.size(); ++column) {
    set_delay(column, -1, 0);
  }
  if (!whole_.in_time_) delays_.clear();
  for (std::size_t bit = 0; bit < whole_.delays_.size(); ++bit) {
    const std::size_t k = bit / VoxelChanges::kKinds;
    if (k >= delays_.size()) break;
    whole_.delays_[bit][index_] =
        whole_.kept_.keep(delays_[k].code(whole_.layers_, 1U << (bit % VoxelChanges::kKinds)));
  }
  delays_.clear();
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
  const bool delayed = in_time_ && std::ranges::any_of(delays_, any);
  const bool designed_alike = !any(designed_other_);
  const std::span<const KeptVoxels::Stream> delays =
      in_time_ ? std::span(delays_) : std::span<const KeptVoxels::Stream>();
  parallel_for(silent(context_), "", 2, [&](std::size_t i) {
    if (i == 0) {
      judged->printed =
          kept_.follow({printed_, nullptr, delays}, grid, frame, {true, least_neck_mm2});
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
