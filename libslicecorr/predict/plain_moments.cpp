// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "predict/plain_moments.hpp"

#include <algorithm>
#include <bit>

#include "base/byte_bits.hpp"
#include "predict/gel_step.hpp"
#include "slicecorr/dose.hpp"

namespace slicecorr::detail {

PlainMoments::PlainMoments(const CureModel& model, const PixelCurve& curve, std::size_t columns,
                           int longest, double beyond_reach)
    : model_(model),
      curve_(curve),
      longest_(longest),
      step_(gel_step(model)),
      log2_step_(std::countr_zero(static_cast<unsigned>(step_))),
      least_(1.0 - kSameDose - beyond_reach),
      blocks_((columns + kLanes - 1) / kLanes) {
  while (static_cast<int>(ring_) < longest / step_ + 2) ring_ *= 2;
  for (double left = 1.0; left > 1e-18; left *= model.a) faded_.push_back(left);
}

LaneMask PlainMoments::take(Block& b, int slice, const std::uint8_t* pixels, std::size_t lanes) {
  std::uint8_t now[kLanes] = {};
  std::copy_n(pixels, lanes, now);
  LaneMask changed = ~LaneMask{0} >> (kLanes - lanes);
  if (b.last < 0) {
    b.last = slice;
    b.node = slice + 1;
  } else {
    changed = differing(now, b.pixels);
  }
  if (changed != 0) std::copy_n(now, kLanes, b.pixels);
  return changed;
}

void PlainMoments::go_down_to(std::size_t block, int slice) {
  Block& b = blocks_[block];
  const int passed = b.node - slice - 1;
  const auto down = [&](int slices, double* to) {
    // Slices that were not looked at show what the last of them does.
    const double left = faded(slices);
    for (std::size_t i = 0; i < kLanes; ++i) {
      to[i] = b.light[i] + (b.dose[i] - b.light[i]) * left;
    }
  };
  // Nothing comes after the last slice. Most columns around a part never come further than that.
  if (slice == b.last) return;
  if (!b.after_steps) {
    b.after_steps = std::make_unique_for_overwrite<double[]>(ring_ * kLanes);
  }
  const int highest = std::min(b.node - 1, end_of_step(slice + longest_, step_));
  for (int n = end_of_step(slice, step_); n <= highest; n += step_) {
    double* const after = after_step(b, n >> log2_step_);
    if (n + 1 == b.node) {
      copy_lanes(b.dose, after);
    } else {
      down(b.node - n - 1, after);
    }
  }
  if (passed == 0) return;
  down(passed, b.dose);
  b.known = 0;
}

int PlainMoments::look(std::size_t block, std::size_t lane, int slice, double beyond) {
  Block& b = blocks_[block];
  const auto left = [&](int step) {
    const int end = end_of_step(step << log2_step_, step_);
    return end >= b.last ? 0.0 : faded(end - slice) * after_step(b, step)[lane];
  };
  const int lowest = slice >> log2_step_;
  const int highest = std::min(b.last, slice + longest_) >> log2_step_;
  int step = std::clamp(b.waits_for[lane], lowest, highest);
  // What is left after the step and, where that is known, after the one before it.
  double after = left(step), before = 0;
  if (after <= beyond) {
    for (; step > lowest; --step) {
      before = left(step - 1);
      if (before > beyond) break;
      after = before;
    }
  } else {
    for (; step < highest && after > beyond; ++step) {
      before = after;
      after = left(step + 1);
    }
  }
  b.waits_for[lane] = step;
  b.left[lane] = b.before[lane] = 0;
  // What gels at last, by less than what doses are compared to.
  if (step == highest && after > beyond) return longest_;
  const int first = step << log2_step_, end = end_of_step(first, step_);
  if (int n = std::min(end, b.last); b.since[lane] >= n) {
    // By light that has been the same: layers below wait as long.
    const double added = model_.one_minus_a * b.light[lane];
    double dose = n == b.last ? 0.0 : after_step(b, step)[lane];
    for (; n > std::max(first, slice); --n) {
      dose = added + model_.a * dose;
      if (faded(n - 1 - slice) * dose > beyond) break;
    }
    return n - slice;
  }
  b.left[lane] = after;
  if (step > lowest) b.before[lane] = before;
  return -1 - end;
}

void PlainMoments::add_block(std::size_t block, int slice, LaneMask changed, const Sink& sink) {
  Block& b = blocks_[block];
  b.active |= changed;
  if (b.active == 0) return;
  go_down_to(block, slice);
  for (LaneMask m = changed; m; m &= m - 1) {
    const auto i = static_cast<std::size_t>(std::countr_zero(m));
    b.light[i] = curve_[b.pixels[i]];
    b.since[i] = slice;
  }
  b.node = slice;
  alignas(64) double beyond[kLanes];
  const MomentLanes is = moment_lanes({model_.a, model_.root_a, model_.one_minus_a, least_, b.light,
                                       b.dose, b.left, b.before, beyond});
  const auto tell = [&](std::size_t lane, int value) {
    if (b.told[lane] == value) return;
    b.told[lane] = value;
    wanted_ = sink(block * kLanes + lane, slice, value) && wanted_;
  };
  // What never gels needs no moment; with the same light the slices before it do not either where that
  // light alone would not do.
  const LaneMask own = b.active & (is.own | ~is.may_gel);
  const LaneMask goes_on = b.active & ~own & b.at_once & b.known & is.as_before;
  const LaneMask looked = b.active & ~own & ~goes_on;
  b.active &= ~(own & (is.may_gel | ~is.bright));
  b.at_once &= ~own;
  for (LaneMask m = looked | (own & ~b.told_own); m; m &= m - 1) {
    const auto i = static_cast<std::size_t>(std::countr_zero(m));
    const LaneMask lane = LaneMask{1} << i;
    if (own & lane) {
      tell(i, 0);
      continue;
    }
    const int value = look(block, i, slice, beyond[i]);
    tell(i, value);
    b.at_once = value < 0 ? b.at_once | lane : b.at_once & ~lane;
    if (value >= 0 && value < longest_ && b.since[i] - slice >= value) b.active &= ~lane;
  }
  b.told_own = (b.told_own | own) & ~looked;
  b.known = goes_on | looked;
}

void PlainMoments::add_slice(int slice, std::size_t first, std::size_t columns,
                             const std::uint8_t* pixels, const Sink& sink) {
  if (!pixels || !wanted_) return;
  for (std::size_t begin = 0; begin < columns; begin += kLanes) {
    const std::size_t block = (first + begin) / kLanes;
    const LaneMask changed =
        take(blocks_[block], slice, pixels + begin, std::min(kLanes, columns - begin));
    add_block(block, slice, changed, sink);
  }
}

}  // namespace slicecorr::detail
