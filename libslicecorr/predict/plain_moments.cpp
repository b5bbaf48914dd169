// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "predict/plain_moments.hpp"

#include <algorithm>
#include <bit>
#include <cstring>

#include "slicecorr/dose.hpp"

namespace slicecorr::detail {

PlainMoments::PlainMoments(const CureModel& model, const PixelCurve& curve, std::size_t columns,
                           int longest, double beyond_reach)
    : model_(model),
      curve_(curve),
      longest_(longest),
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
  const std::uint8_t* const before = row(block, slice + 1);
  LaneMask changed = 0;
  if (std::memcmp(now, before, lanes) == 0) return changed;
  for (std::size_t i = 0; i < lanes; ++i) {
    changed |= static_cast<LaneMask>(now[i] != before[i]) << i;
  }
  return changed;
}

int PlainMoments::look(std::size_t block, std::size_t lane, int slice, double beyond) {
  Block& b = blocks_[block];
  const auto light = [&](int n) { return curve_[row(block, n)[lane]]; };
  const auto with = [&](int n, double later) {
    return model_.one_minus_a * light(n) + model_.a * later;
  };
  int n = b.waits_for[lane];
  double later = b.later[lane];
  if (!(b.known >> lane & 1) || n < slice || n - slice > longest_) {
    n = slice;
    // The node above: what the block's dose was before this slice.
    later = std::max(0.0, (b.dose[lane] - model_.one_minus_a * light(slice)) / model_.a);
  }
  const int past = std::min(b.last, slice + longest_);
  const auto gelled = [&] { return faded(n - slice) * later <= beyond; };
  if (gelled()) {
    for (; n > slice; --n) {
      const double one_less = with(n, later);
      if (faded(n - 1 - slice) * one_less > beyond) break;
      later = one_less;
    }
  } else {
    while (n < past && !gelled()) {
      ++n;
      later = std::max(0.0, (later - model_.one_minus_a * light(n)) / model_.a);
    }
  }
  b.waits_for[lane] = n;
  b.later[lane] = later;
  b.left[lane] = faded(n - slice) * later;
  b.before[lane] = n > slice ? faded(n - 1 - slice) * with(n, later) : b.left[lane];
  // What gels at last, by less than what doses are compared to.
  if (n == past && !gelled()) return longest_;
  const int delay = n - slice, told = b.told[lane];
  // Twice the same delay: so it may go on.
  const bool at_once = b.at_once >> lane & 1;
  const bool alike = at_once ? (b.known >> lane & 1) && -1 - told == n + 1 : told == delay;
  return alike ? delay : -1 - n;
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
