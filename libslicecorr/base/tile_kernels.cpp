#include <cstring>

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

template <class D, class M>
LaneMask bits_of(D d, M mask) {
  std::uint8_t bytes[8] = {};
  hn::StoreMaskBits(d, mask, bytes);
  LaneMask bits;
  std::memcpy(&bits, bytes, sizeof bits);
  return bits;
}

hn::Mask<Doubles> mask_of(Doubles d, LaneMask lanes, std::size_t first) {
  const auto byte = static_cast<std::uint8_t>(lanes >> first);
  const std::uint8_t bytes[8] = {byte};
  return hn::LoadMaskBits(d, bytes);
}

void TileChanges(const std::uint8_t* rows, std::size_t stride, int count, LaneMask* steady,
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

void TileClasses(const std::uint8_t* rows, std::size_t stride, int count, LaneMask* zero,
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

void StepOnce(const double* add, double a, const double* from, double* to) {
  const Doubles d;
  const auto factor = hn::Set(d, a);
  for (std::size_t l = 0; l < kLanes; l += hn::Lanes(d)) {
    const auto dose = hn::Add(hn::LoadU(d, add + l), hn::Mul(factor, hn::LoadU(d, from + l)));
    hn::StoreU(dose, d, to + l);
  }
}

void StepMany(const double* add, double a, double* dose, int slices) {
  const Doubles d;
  const std::size_t n = hn::Lanes(d);
  const auto factor = hn::Set(d, a);
  // Eight chains of operations at once, or each would wait for its own last result.
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

LaneMask Printed(const double* dose) {
  const Doubles d;
  const auto one = hn::Set(d, 1.0);
  LaneMask printed = 0;
  for (std::size_t l = 0; l < kLanes; l += hn::Lanes(d)) {
    printed |= bits_of(d, hn::Ge(hn::LoadU(d, dose + l), one)) << l;
  }
  return printed;
}

PrintedLanes Predict(const PredictStep& s) {
  const Doubles d;
  const auto one = hn::Set(d, 1.0);
  const auto a = hn::Set(d, s.a), root = hn::Set(d, s.root_a);
  PrintedLanes printed{};
  for (std::size_t l = 0; l < kLanes; l += hn::Lanes(d)) {
    const auto from = hn::LoadU(d, s.from + l);
    const auto dose = hn::Add(hn::LoadU(d, s.add + l), hn::Mul(a, from));
    const auto middle = hn::Add(hn::LoadU(d, s.add_middle + l), hn::Mul(root, from));
    hn::StoreU(dose, d, s.to + l);
    printed.node |= bits_of(d, hn::Ge(dose, one)) << l;
    printed.middle |= bits_of(d, hn::Ge(middle, one)) << l;
    const auto run = mask_of(d, s.run, l), gap = mask_of(d, s.gap, l);
    const auto low = hn::LoadU(d, s.inside_low + l), high = hn::LoadU(d, s.inside_high + l),
               out = hn::LoadU(d, s.outside_high + l), least = hn::LoadU(d, s.gap_low + l);
    hn::StoreU(hn::IfThenElse(run, hn::Min(middle, low), low), d, s.inside_low + l);
    hn::StoreU(hn::IfThenElse(run, hn::Max(middle, high), high), d, s.inside_high + l);
    hn::StoreU(hn::IfThenElse(gap, hn::Max(middle, out), out), d, s.outside_high + l);
    hn::StoreU(hn::IfThenElse(gap, hn::Min(dose, least), least), d, s.gap_low + l);
  }
  return printed;
}

}  // namespace
}  // namespace HWY_NAMESPACE
}  // namespace slicecorr::detail
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace slicecorr::detail {

HWY_EXPORT(TileChanges);
HWY_EXPORT(TileClasses);
HWY_EXPORT(StepOnce);
HWY_EXPORT(StepMany);
HWY_EXPORT(Printed);
HWY_EXPORT(Predict);

void tile_changes(const std::uint8_t* rows, std::size_t stride, int count, LaneMask* steady,
                  LaneMask* changed) {
  HWY_DYNAMIC_DISPATCH(TileChanges)(rows, stride, count, steady, changed);
}
void tile_classes(const std::uint8_t* rows, std::size_t stride, int count, LaneMask* zero,
                  LaneMask* full) {
  HWY_DYNAMIC_DISPATCH(TileClasses)(rows, stride, count, zero, full);
}
void step_lanes(const double* add, double a, const double* from, double* to) {
  HWY_DYNAMIC_DISPATCH(StepOnce)(add, a, from, to);
}
void step_lanes(const double* add, double a, double* dose, int slices) {
  HWY_DYNAMIC_DISPATCH(StepMany)(add, a, dose, slices);
}
LaneMask printed_lanes(const double* dose) { return HWY_DYNAMIC_DISPATCH(Printed)(dose); }
PrintedLanes predict_lanes(const PredictStep& step) { return HWY_DYNAMIC_DISPATCH(Predict)(step); }

}  // namespace slicecorr::detail
#endif
