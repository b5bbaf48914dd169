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
      least_(1.0 - kSameDose - beyond_reach),
      blocks_((columns + kLanes - 1) / kLanes) {
  while (ring_ < static_cast<std::size_t>(longest) + 1) ring_ *= 2;
  pixels_.resize(blocks_.size() * ring_ * kLanes);
  for (double left = 1.0; left > 1e-18; left *= model.a) faded_.push_back(left);
}

LaneMask PlainMoments::take(std::size_t block, int slice, const std::uint8_t* pixels,
                            std::size_t lanes) {
  std::uint8_t* const now = row(block, slice);
  std::copy_n(pixels, lanes, now);
  Block& b = blocks_[block];
  if (b.last < 0) {
    b.last = slice;
    b.node = slice + 1;
    return ~LaneMask{0} >> (kLanes - lanes);
  }
  return differing(now, row(block, slice + 1));
}

int PlainMoments::look(std::size_t block, std::size_t lane, int slice, double beyond) {
  Block& b = blocks_[block];
  const auto light = [&](int n) { return curve_[row(block, n)[lane]]; };
  /// The dose at the far node of slice n, of what comes after it.
  struct After {
    int n;
    double dose;
  };
  const auto one_less = [&](const After& at) {
    return After{at.n - 1, model_.one_minus_a * light(at.n) + model_.a * at.dose};
  };
  const auto one_more = [&](const After& at) {
    const double dose = (at.dose - model_.one_minus_a * light(at.n + 1)) / model_.a;
    return After{at.n + 1, std::max(0.0, dose)};
  };
  const auto left = [&](const After& at) { return faded(at.n - slice) * at.dose; };
  After at{b.waits_for[lane], b.later[lane]};
  if (!(b.known >> lane & 1) || at.n < slice || at.n - slice > longest_) {
    // At the node above: what the block's dose was before this slice.
    at = one_more({slice - 1, b.dose[lane]});
  }
  const int past = std::min(b.last, slice + longest_);
  if (left(at) <= beyond) {
    while (at.n > slice) {
      const After before = one_less(at);
      if (left(before) > beyond) break;
      at = before;
    }
  } else {
    while (at.n < past && left(at) > beyond) at = one_more(at);
  }
  b.waits_for[lane] = at.n;
  b.later[lane] = at.dose;
  b.left[lane] = 0;
  b.before[lane] = 0;
  // What gels at last, by less than what doses are compared to.
  if (at.n == past && left(at) > beyond) return longest_;
  if (b.since[lane] >= at.n) return at.n - slice;  // by light that has been the same
  const int end = end_of_step(at.n, step_);
  After later = at, before = at;
  while (later.n < std::min(end, past)) later = one_more(later);
  if (later.n == end) b.left[lane] = left(later);
  while (before.n > std::max(end - step_, slice)) before = one_less(before);
  if (before.n == end - step_) b.before[lane] = left(before);
  return -1 - end;
}

void PlainMoments::add_block(std::size_t block, int slice, LaneMask changed, const Sink& sink) {
  Block& b = blocks_[block];
  b.active |= changed;
  if (b.active == 0) return;
  if (const int passed = b.node - slice - 1; passed > 0) {
    // Slices that were not looked at show what the last of them does.
    const double left = faded(passed);
    for (std::size_t i = 0; i < kLanes; ++i) {
      b.dose[i] = b.light[i] + (b.dose[i] - b.light[i]) * left;
    }
    b.known = 0;
  }
  const std::uint8_t* const now = row(block, slice);
  for (LaneMask m = changed; m; m &= m - 1) {
    const auto i = static_cast<std::size_t>(std::countr_zero(m));
    b.light[i] = curve_[now[i]];
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
  for (LaneMask m = own & ~b.told_own; m; m &= m - 1) {
    tell(static_cast<std::size_t>(std::countr_zero(m)), 0);
  }
  const LaneMask goes_on = b.active & ~own & b.at_once & b.known & is.as_before;
  const LaneMask looked = b.active & ~own & ~goes_on;
  b.active &= ~(own & (is.may_gel | ~is.bright));
  b.told_own |= own;
  b.at_once &= ~own;
  for (LaneMask m = looked; m; m &= m - 1) {
    const auto i = static_cast<std::size_t>(std::countr_zero(m));
    const int value = look(block, i, slice, beyond[i]);
    const LaneMask lane = LaneMask{1} << i;
    tell(i, value);
    b.told_own &= ~lane;
    b.at_once = value < 0 ? b.at_once | lane : b.at_once & ~lane;
    if (value >= 0 && value < longest_ && b.since[i] - slice >= value) b.active &= ~lane;
  }
  b.known = goes_on | looked;
}

void PlainMoments::add_slice(int slice, std::size_t first, std::size_t columns,
                             const std::uint8_t* pixels, const Sink& sink) {
  if (!pixels || !wanted_) return;
  for (std::size_t begin = 0; begin < columns; begin += kLanes) {
    const std::size_t block = (first + begin) / kLanes;
    const LaneMask changed = take(block, slice, pixels + begin, std::min(kLanes, columns - begin));
    add_block(block, slice, changed, sink);
  }
}

}  // namespace slicecorr::detail
