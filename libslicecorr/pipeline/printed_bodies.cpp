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
      designed_(bands.size()),
      whole_(bands.size()),
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
    const int design = (alone || coverage > kLeftAlone ? kDesigned : 0) |
                       (alone || coverage == kFull ? kWhole : 0);
    const auto state = [&](bool printed) {
      return static_cast<std::uint8_t>(design | (printed ? kPrinted : 0));
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
  const auto printed = changes_.code(whole_.layers_, kPrinted);
  whole_.printed_[index_] = whole_.kept_.keep(printed);
  const auto keep = [&](unsigned kind, KeptVoxels::Stream& to, std::atomic<bool>& alike) {
    const auto code = changes_.code(whole_.layers_, kind);
    if (code == printed) {
      to[index_] = whole_.printed_[index_];
      return;
    }
    alike = false;
    to[index_] = whole_.kept_.keep(code);
  };
  keep(kDesigned, whole_.designed_, whole_.designed_alike_);
  keep(kWhole, whole_.whole_, whole_.whole_alike_);
}

std::shared_ptr<const JudgedBodies> PrintedBodies::judge(const Grid& grid, const ImageFrame& frame,
                                                         const LayerHeights& heights,
                                                         double least_neck_mm2) const {
  auto judged = std::make_shared<JudgedBodies>();
  const bool delayed =
      in_time_ && std::ranges::any_of(delays_, [](const KeptVoxels::Stream& bit) {
        return std::ranges::any_of(bit, [](const auto& pieces) { return !pieces.empty(); });
      });
  parallel_for(silent(context_), "", 3, [&](std::size_t i) {
    if (i == 0) {
      judged->printed =
          kept_.follow(printed_, grid, frame, {true, least_neck_mm2},
                       in_time_ ? std::span(delays_) : std::span<const KeptVoxels::Stream>());
      judged->printed.in_time = in_time_;
    } else if (i == 1 && (!designed_alike_ || delayed)) {
      judged->designed = kept_.follow(designed_, grid, frame, {false, 0});
    } else if (i == 2 && !whole_alike_) {
      judged->loose_whole = kept_.follow(whole_, grid, frame, {false, 0}).loose_bodies;
    }
  });
  // What prints as designed hangs together in the end, but not from slice to slice.
  if (designed_alike_ && !delayed) judged->designed = judged->printed;
  if (whole_alike_) judged->loose_whole = judged->printed.loose_bodies;
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
