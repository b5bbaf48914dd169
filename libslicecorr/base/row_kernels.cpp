// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <cstring>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "base/row_kernels.cpp"
#include <hwy/foreach_target.h>
// First of all foreach_target.h, which includes this file once for each instruction set.
#include <hwy/highway.h>

#include "base/row_kernels.hpp"

HWY_BEFORE_NAMESPACE();
namespace slicecorr::detail {
namespace HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;

using Bytes = hn::CappedTag<std::uint8_t, kRowWord>;

/// Lanes of a mask as the low bits of a number. They are read back in the width in which they were
/// written, or the processor would wait for the store.
template <class M>
std::uint64_t bits_of(Bytes d, M mask) {
  constexpr std::size_t size = (hn::MaxLanes(Bytes()) + 7) / 8;
  std::uint8_t bytes[size];
  hn::StoreMaskBits(d, mask, bytes);
  std::uint64_t bits = 0;
  std::memcpy(&bits, bytes, size);
  return bits;
}

void changes_kernel(const std::uint8_t* pixels, std::size_t words, std::uint64_t* changes) {
  const Bytes d;
  for (std::size_t w = 0; w < words; ++w, pixels += kRowWord) {
    std::uint64_t equal = 0;
    for (std::size_t l = 0; l < kRowWord; l += hn::Lanes(d)) {
      const auto before = hn::LoadU(d, pixels + l - 1);
      equal |= bits_of(d, hn::Eq(hn::LoadU(d, pixels + l), before)) << l;
    }
    changes[w] = ~equal;
  }
}

std::uint64_t lit_kernel(const std::uint8_t* pixels, std::size_t words, std::uint64_t* lit) {
  const Bytes d;
  const hn::Repartition<std::uint64_t, Bytes> wide;
  auto sums = hn::Zero(wide);
  for (std::size_t w = 0; w < words; ++w, pixels += kRowWord) {
    std::uint64_t black = 0;
    for (std::size_t l = 0; l < kRowWord; l += hn::Lanes(d)) {
      const auto row = hn::LoadU(d, pixels + l);
      black |= bits_of(d, hn::Eq(row, hn::Zero(d))) << l;
      sums = hn::Add(sums, hn::SumsOf8(row));
    }
    lit[w] = ~black;
  }
  return hn::GetLane(hn::SumOfLanes(wide, sums));
}

bool greys_kernel(const std::uint8_t* pixels, std::size_t words, std::uint8_t* copy,
                  std::uint64_t* greys) {
  const Bytes d;
  std::uint64_t any = 0;
  for (std::size_t w = 0; w < words; ++w, pixels += kRowWord, copy += kRowWord) {
    std::uint64_t plain = 0;
    for (std::size_t l = 0; l < kRowWord; l += hn::Lanes(d)) {
      const auto row = hn::LoadU(d, pixels + l);
      hn::StoreU(row, d, copy + l);
      const auto is_plain = hn::Or(hn::Eq(row, hn::Zero(d)), hn::Eq(row, hn::Set(d, 255)));
      plain |= bits_of(d, is_plain) << l;
    }
    greys[w] = ~plain;
    any |= ~plain;
  }
  return any != 0;
}

}  // namespace
// NOLINTNEXTLINE(google-readability-namespace-comments)
}  // namespace HWY_NAMESPACE
}  // namespace slicecorr::detail
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace slicecorr::detail {

HWY_EXPORT(changes_kernel);
HWY_EXPORT(lit_kernel);
HWY_EXPORT(greys_kernel);

void find_changes(const std::uint8_t* pixels, std::size_t words, std::uint64_t* changes) {
  HWY_DYNAMIC_DISPATCH(changes_kernel)(pixels, words, changes);
}
std::uint64_t find_lit(const std::uint8_t* pixels, std::size_t words, std::uint64_t* lit) {
  return HWY_DYNAMIC_DISPATCH(lit_kernel)(pixels, words, lit);
}
bool copy_and_find_greys(const std::uint8_t* pixels, std::size_t words, std::uint8_t* copy,
                         std::uint64_t* greys) {
  return HWY_DYNAMIC_DISPATCH(greys_kernel)(pixels, words, copy, greys);
}

}  // namespace slicecorr::detail
#endif
