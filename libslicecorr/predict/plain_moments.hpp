// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// When the middles of layers gel where the recursion (A.32) describes the dose as it stands. What slices
/// after n leave in the middle of layer m is the dose at the far node of slice n, of these alone, times
/// sqrt(a) a^(n - m). So layer m has gelled in slice n when that is no more than what its dose is beyond 1
/// in the end; neighbouring layers wait for nearly the same slice, and no sums are needed. What the slices
/// after each step in time leave is kept, so that a layer finds its step by a few comparisons.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <vector>

#include "base/tile_kernels.hpp"
#include "slicecorr/cure.hpp"

namespace slicecorr::detail {

/// Follows the columns of a band from the last slice to the first, 64 lanes at once. Not thread-safe.
class PlainMoments {
 public:
  /// As `BandPredictor::DelaySink`.
  using Sink = std::function<bool(std::size_t column, int slice, int delay)>;
  /// `model` is plain; it and `curve` outlive this. `longest`: delays are at most this; what slices
  /// further away leave is at most `beyond_reach`.
  PlainMoments(const CureModel& model, const PixelCurve& curve, std::size_t columns, int longest,
               double beyond_reach);
  /// As `GelMoments::add_slice`.
  void add_slice(int slice, std::size_t first, std::size_t columns, const std::uint8_t* pixels,
                 const Sink& sink);

 private:
  struct Block {
    double dose[kLanes] = {};   ///< at node `node`
    double light[kLanes] = {};  ///< that lanes are shown there
    double left[kLanes] = {};   ///< in the layer at hand, of slices after the step in which it gels
    double before[kLanes] = {};  ///< the same, of slices after the step before; 0: not known
    std::int32_t waits_for[kLanes] = {};    ///< step of the layer looked at last
    std::uint8_t pixels[kLanes] = {};       ///< of the slice taken last
    std::int32_t told[kLanes] = {};         ///< as told last
    std::int32_t since[kLanes] = {};        ///< the light is the same from here down
    int node = 0;                           ///< the slice looked at last
    int last = -1;                          ///< slice with light; -1: not known yet
    std::unique_ptr<double[]> after_steps;  ///< see `after_step`; null: none was kept
    LaneMask active = 0;                    ///< what is told may change
    LaneMask known = 0;                     ///< `left` and `before` hold
    LaneMask at_once = 0;                   ///< `told` is a slice in which layers gel at once
    LaneMask told_own = ~LaneMask{0};       ///< each gels in its own slice, or never
  };
  /// Of a block: the dose at the far node of the last slice of a step, of what comes after it.
  double* after_step(const Block& block, int step) const {
    return &block.after_steps[(static_cast<std::size_t>(step) & (ring_ - 1)) * kLanes];
  }
  double faded(int slices) const {
    const auto j = static_cast<std::size_t>(slices);
    return j < faded_.size() ? faded_[j] : 0.0;
  }
  /// Takes the pixels of a slice; which lanes differ from the slice taken before.
  LaneMask take(Block& block, int slice, const std::uint8_t* pixels, std::size_t lanes);
  /// Brings a block down to the upper node of a slice, and keeps what it is there after each step.
  void go_down_to(std::size_t block, int slice);
  /// Looks at the layer of a lane that gels later than in its own slice, whose dose is `beyond` 1 at its
  /// upper node; gives what is to be told of it.
  int look(std::size_t block, std::size_t lane, int slice, double beyond);
  void add_block(std::size_t block, int slice, LaneMask changed, const Sink& sink);

  const CureModel& model_;
  const PixelCurve& curve_;
  const int longest_;
  const int step_;  ///< layers that gel in the same step of so many slices are told alike
  const int log2_step_;
  const double least_;  ///< dose of a middle that may gel
  bool wanted_ = true;
  std::size_t ring_ = 1;       ///< steps kept, a power of two
  std::vector<double> faded_;  ///< a^j, by j
  std::vector<Block> blocks_;
};

}  // namespace slicecorr::detail
