// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <cstring>
#include <limits>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "base/tile_kernels.cpp"
#include <hwy/foreach_target.h>
// First of all foreach_target.h, which includes this file once for each instruction set.
#include <hwy/highway.h>

#include "base/tile_kernels.hpp"

HWY_BEFORE_NAMESPACE();
namespace slicecorr::detail {
namespace HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;

using Bytes = hn::CappedTag<std::uint8_t, kLanes>;
using Doubles = hn::CappedTag<double, 8>;

/// Lanes of a mask as the low bits of a number. They are read back in the width in which they were
/// written, or the processor would wait for the store.
template <class D, class M>
LaneMask bits_of(D d, M mask) {
  constexpr std::size_t size = (hn::MaxLanes(D()) + 7) / 8;
  std::uint8_t bytes[size];
  hn::StoreMaskBits(d, mask, bytes);
  LaneMask bits = 0;
  std::memcpy(&bits, bytes, size);
  return bits;
}

hn::Mask<Doubles> mask_of(Doubles d, LaneMask lanes, std::size_t first) {
  const auto byte = static_cast<std::uint8_t>(lanes >> first);
  return hn::LoadMaskBits(d, &byte);
}

void tile_changes_kernel(const std::uint8_t* rows, std::size_t stride, int count, LaneMask* steady,
                         LaneMask* changed) {
  const Bytes d;
  const auto zero = hn::Zero(d);
  const auto full = hn::Set(d, std::uint8_t{255});
  for (int k = 0; k < count; ++k, rows += stride) {
    LaneMask equal = 0, even = 0;
    for (std::size_t l = 0; l < kLanes; l += hn::Lanes(d)) {
      const auto row = hn::LoadU(d, rows + l);
      const auto same = hn::Eq(row, hn::LoadU(d, rows + l - stride));
      const auto end = hn::Or(hn::Eq(row, zero), hn::Eq(row, full));
      equal |= bits_of(d, same) << l;
      even |= bits_of(d, end) << l;
    }
    steady[k] = equal & even;
    changed[k] = ~equal;
  }
}

void tile_classes_kernel(const std::uint8_t* rows, std::size_t stride, int count, LaneMask* zero,
                         LaneMask* full) {
  const Bytes d;
  for (int k = 0; k < count; ++k, rows += stride) {
    LaneMask zeros = 0, fulls = 0;
    for (std::size_t l = 0; l < kLanes; l += hn::Lanes(d)) {
      const auto row = hn::LoadU(d, rows + l);
      zeros |= bits_of(d, hn::Eq(row, hn::Zero(d))) << l;
      fulls |= bits_of(d, hn::Eq(row, hn::Set(d, std::uint8_t{255}))) << l;
    }
    zero[k] = zeros;
    full[k] = fulls;
  }
}

void step_kernel(const double* add, double a, const double* from, double* to) {
  const Doubles d;
  const auto factor = hn::Set(d, a);
  for (std::size_t l = 0; l < kLanes; l += hn::Lanes(d)) {
    const auto dose = hn::Add(hn::LoadU(d, add + l), hn::Mul(factor, hn::LoadU(d, from + l)));
    hn::StoreU(dose, d, to + l);
  }
}

void steps_kernel(const double* add, double a, double* dose, int slices) {
  const Doubles d;
  const std::size_t n = hn::Lanes(d);
  const auto factor = hn::Set(d, a);
  // Eight chains of operations at once: a single one would wait for its own last result.
  for (std::size_t l = 0; l < kLanes; l += 8 * n) {
    double* const at = dose + l;
    const double* const plus = add + l;
    auto v0 = hn::LoadU(d, at), v1 = hn::LoadU(d, at + n), v2 = hn::LoadU(d, at + 2 * n),
         v3 = hn::LoadU(d, at + 3 * n), v4 = hn::LoadU(d, at + 4 * n),
         v5 = hn::LoadU(d, at + 5 * n), v6 = hn::LoadU(d, at + 6 * n),
         v7 = hn::LoadU(d, at + 7 * n);
    const auto p0 = hn::LoadU(d, plus), p1 = hn::LoadU(d, plus + n),
               p2 = hn::LoadU(d, plus + 2 * n), p3 = hn::LoadU(d, plus + 3 * n),
               p4 = hn::LoadU(d, plus + 4 * n), p5 = hn::LoadU(d, plus + 5 * n),
               p6 = hn::LoadU(d, plus + 6 * n), p7 = hn::LoadU(d, plus + 7 * n);
    // Long after the last change of light doses stay the same, to the last bit.
    const auto stays = [&](auto v, auto p) {
      return hn::AllTrue(d, hn::Eq(hn::Add(p, hn::Mul(factor, v)), v));
    };
    if (stays(v0, p0) && stays(v1, p1) && stays(v2, p2) && stays(v3, p3) && stays(v4, p4) &&
        stays(v5, p5) && stays(v6, p6) && stays(v7, p7)) {
      continue;
    }
    for (int s = 0; s < slices; ++s) {
      v0 = hn::Add(p0, hn::Mul(factor, v0));
      v1 = hn::Add(p1, hn::Mul(factor, v1));
      v2 = hn::Add(p2, hn::Mul(factor, v2));
      v3 = hn::Add(p3, hn::Mul(factor, v3));
      v4 = hn::Add(p4, hn::Mul(factor, v4));
      v5 = hn::Add(p5, hn::Mul(factor, v5));
      v6 = hn::Add(p6, hn::Mul(factor, v6));
      v7 = hn::Add(p7, hn::Mul(factor, v7));
    }
    hn::StoreU(v0, d, at);
    hn::StoreU(v1, d, at + n);
    hn::StoreU(v2, d, at + 2 * n);
    hn::StoreU(v3, d, at + 3 * n);
    hn::StoreU(v4, d, at + 4 * n);
    hn::StoreU(v5, d, at + 5 * n);
    hn::StoreU(v6, d, at + 6 * n);
    hn::StoreU(v7, d, at + 7 * n);
  }
}

LaneMask printed_kernel(const double* dose) {
  const Doubles d;
  const auto one = hn::Set(d, 1.0);
  LaneMask printed = 0;
  for (std::size_t l = 0; l < kLanes; l += hn::Lanes(d)) {
    printed |= bits_of(d, hn::Ge(hn::LoadU(d, dose + l), one)) << l;
  }
  return printed;
}

LaneMask later_kernel(const std::int32_t* until, std::int32_t slice, std::int32_t* greatest) {
  const hn::CappedTag<std::int32_t, 16> d;
  const auto now = hn::Set(d, slice);
  auto most = hn::Set(d, std::numeric_limits<std::int32_t>::min());
  LaneMask later = 0;
  for (std::size_t l = 0; l < kLanes; l += hn::Lanes(d)) {
    const auto v = hn::LoadU(d, until + l);
    const auto is = hn::Gt(v, now);
    later |= bits_of(d, is) << l;
    most = hn::Max(most, hn::IfThenElse(is, most, v));
  }
  *greatest = hn::GetLane(hn::MaxOfLanes(d, most));
  return later;
}

PrintedLanes predict_kernel(const PredictStep& s) {
  const Doubles d;
  const auto one = hn::Set(d, 1.0);
  const auto a = hn::Set(d, s.a), root = hn::Set(d, s.root_a);
  // Copied, because the compiler must assume that stores to doubles change members of `s`.
  const double *const add = s.add, *const add_middle = s.add_middle, *const before = s.from;
  double *const to = s.to, *const inside_low = s.inside_low, *const inside_high = s.inside_high,
                *const outside_high = s.outside_high, *const stretch_low = s.stretch_low;
  const LaneMask runs = s.run, gaps = s.gap, stays = s.stays;
  LaneMask at_node = 0, in_middle = 0;
  for (std::size_t l = 0; l < kLanes; l += hn::Lanes(d)) {
    const auto from = hn::LoadU(d, before + l);
    const auto dose = hn::Add(hn::LoadU(d, add + l), hn::Mul(a, from));
    const auto middle = hn::Add(hn::LoadU(d, add_middle + l), hn::Mul(root, from));
    hn::StoreU(dose, d, to + l);
    at_node |= bits_of(d, hn::Ge(dose, one)) << l;
    in_middle |= bits_of(d, hn::Ge(middle, one)) << l;
    const auto run = mask_of(d, runs, l), gap = mask_of(d, gaps, l), stay = mask_of(d, stays, l);
    const auto low = hn::LoadU(d, inside_low + l), high = hn::LoadU(d, inside_high + l),
               out = hn::LoadU(d, outside_high + l), least = hn::LoadU(d, stretch_low + l);
    hn::StoreU(hn::IfThenElse(run, hn::Min(middle, low), low), d, inside_low + l);
    hn::StoreU(hn::IfThenElse(run, hn::Max(middle, high), high), d, inside_high + l);
    hn::StoreU(hn::IfThenElse(gap, hn::Max(middle, out), out), d, outside_high + l);
    hn::StoreU(hn::IfThenElse(stay, hn::Min(dose, least), least), d, stretch_low + l);
  }
  PrintedLanes printed{};
  printed.node = at_node;
  printed.middle = in_middle;
  printed.in_run = __builtin_popcountll(printed.middle & s.run);
  printed.in_gap = __builtin_popcountll(printed.middle & s.gap);
  printed.run = __builtin_popcountll(s.run);
  return printed;
}

bool prints_alike_kernel(const PredictStep& s, const PrintedLanes& is) {
  const Doubles d;
  const auto one = hn::Set(d, 1.0);
  const auto a = hn::Set(d, s.a), root = hn::Set(d, s.root_a);
  LaneMask at_node = 0, in_middle = 0;
  for (std::size_t l = 0; l < kLanes; l += hn::Lanes(d)) {
    const auto from = hn::LoadU(d, s.from + l);
    const auto dose = hn::Add(hn::LoadU(d, s.add + l), hn::Mul(a, from));
    const auto middle = hn::Add(hn::LoadU(d, s.add_middle + l), hn::Mul(root, from));
    at_node |= bits_of(d, hn::Ge(dose, one)) << l;
    in_middle |= bits_of(d, hn::Ge(middle, one)) << l;
  }
  return at_node == is.node && in_middle == is.middle;
}

MomentLanes moment_kernel(const MomentStep& s) {
  const Doubles d;
  const auto one = hn::Set(d, 1.0), least = hn::Set(d, s.least);
  const auto a = hn::Set(d, s.a), root = hn::Set(d, s.root_a);
  const auto of_slice = hn::Set(d, s.one_minus_a), of_half = hn::Set(d, 1.0 - s.root_a);
  // Copied, because the compiler must assume that stores to doubles change members of `s`.
  const double* const light = s.light;
  double *const dose = s.dose, *const left = s.left, *const before = s.before,
                *const beyond = s.beyond;
  MomentLanes is{};
  for (std::size_t l = 0; l < kLanes; l += hn::Lanes(d)) {
    const auto phi = hn::LoadU(d, light + l), above = hn::LoadU(d, dose + l);
    const auto middle = hn::Add(hn::Mul(of_half, phi), hn::Mul(root, above));
    const auto more = hn::Div(hn::Sub(middle, one), root);
    const auto rest = hn::Mul(a, hn::LoadU(d, left + l));
    const auto with = hn::Mul(a, hn::LoadU(d, before + l));
    hn::StoreU(hn::Add(hn::Mul(of_slice, phi), hn::Mul(a, above)), d, dose + l);
    hn::StoreU(rest, d, left + l);
    hn::StoreU(with, d, before + l);
    hn::StoreU(more, d, beyond + l);
    is.may_gel |= bits_of(d, hn::Ge(middle, least)) << l;
    is.own |= bits_of(d, hn::Le(above, more)) << l;
    is.as_before |= bits_of(d, hn::And(hn::Le(rest, more), hn::Gt(with, more))) << l;
    is.bright |= bits_of(d, hn::Ge(phi, least)) << l;
  }
  return is;
}

void copy_kernel(const double* from, double* to) {
  const Doubles d;
  for (std::size_t l = 0; l < kLanes; l += hn::Lanes(d))
    hn::StoreU(hn::LoadU(d, from + l), d, to + l);
}

}  // namespace
}  // namespace HWY_NAMESPACE
}  // namespace slicecorr::detail
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace slicecorr::detail {

HWY_EXPORT(tile_changes_kernel);
HWY_EXPORT(tile_classes_kernel);
HWY_EXPORT(step_kernel);
HWY_EXPORT(steps_kernel);
HWY_EXPORT(printed_kernel);
HWY_EXPORT(later_kernel);
HWY_EXPORT(predict_kernel);
HWY_EXPORT(prints_alike_kernel);
HWY_EXPORT(copy_kernel);
HWY_EXPORT(moment_kernel);

void tile_changes(const std::uint8_t* rows, std::size_t stride, int count, LaneMask* steady,
                  LaneMask* changed) {
  HWY_DYNAMIC_DISPATCH(tile_changes_kernel)(rows, stride, count, steady, changed);
}
void tile_classes(const std::uint8_t* rows, std::size_t stride, int count, LaneMask* zero,
                  LaneMask* full) {
  HWY_DYNAMIC_DISPATCH(tile_classes_kernel)(rows, stride, count, zero, full);
}
void step_lanes(const double* add, double a, const double* from, double* to) {
  HWY_DYNAMIC_DISPATCH(step_kernel)(add, a, from, to);
}
void step_lanes(const double* add, double a, double* dose, int slices) {
  HWY_DYNAMIC_DISPATCH(steps_kernel)(add, a, dose, slices);
}
LaneMask printed_lanes(const double* dose) { return HWY_DYNAMIC_DISPATCH(printed_kernel)(dose); }
LaneMask later_lanes(const std::int32_t* until, std::int32_t slice, std::int32_t* greatest) {
  return HWY_DYNAMIC_DISPATCH(later_kernel)(until, slice, greatest);
}
PrintedLanes predict_lanes(const PredictStep& step) {
  return HWY_DYNAMIC_DISPATCH(predict_kernel)(step);
}
bool prints_alike(const PredictStep& step, const PrintedLanes& is) {
  return HWY_DYNAMIC_DISPATCH(prints_alike_kernel)(step, is);
}
MomentLanes moment_lanes(const MomentStep& step) {
  return HWY_DYNAMIC_DISPATCH(moment_kernel)(step);
}
void copy_lanes(const double* from, double* to) { HWY_DYNAMIC_DISPATCH(copy_kernel)(from, to); }

}  // namespace slicecorr::detail
#endif
