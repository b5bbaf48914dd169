// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <algorithm>
#include <cmath>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "chemistry/diffusion.cpp"
#include <hwy/foreach_target.h>
// First of all foreach_target.h, which includes this file once for each instruction set.
#include <hwy/highway.h>

#include "chemistry/diffusion.hpp"

HWY_BEFORE_NAMESPACE();
namespace slicecorr::detail {
namespace HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;

/// Most that an exchange against the slope takes of the poorer cell. Some eight such exchanges leave it
/// most of what it has.
constexpr double kMostTaken = 0.01;

/// As many numbers from i on as `d` has lanes.
template <class D>
void exchange_from(D d, std::size_t i, double* out, const double* mid, const double* const* a,
                   const double* const* b, const double* k, std::size_t count) {
  const auto m = hn::LoadU(d, mid + i);
  auto sum = hn::Zero(d);
  for (std::size_t j = 0; j < count; ++j) {
    const auto share = hn::Set(d, k[j]);
    const auto left = hn::LoadU(d, a[j] + i), right = hn::LoadU(d, b[j] + i);
    if (k[j] >= 0) {
      sum = hn::Add(sum, hn::Mul(share, hn::Add(hn::Sub(left, m), hn::Sub(right, m))));
      continue;
    }
    const auto taken = [&](hn::Vec<D> other) {
      const auto most = hn::Mul(hn::Set(d, kMostTaken), hn::Min(other, m));
      const auto asked = hn::Mul(share, hn::Sub(other, m));
      return hn::Max(hn::Min(asked, most), hn::Neg(most));
    };
    sum = hn::Add(sum, hn::Add(taken(left), taken(right)));
  }
  hn::StoreU(hn::Add(m, sum), d, out + i);
}

void exchange_kernel(double* out, const double* mid, const double* const* a, const double* const* b,
                     const double* k, std::size_t count, std::size_t n) {
  const hn::ScalableTag<double> d;
  const hn::CappedTag<double, 1> one;
  std::size_t i = 0;
  for (; i + hn::Lanes(d) <= n; i += hn::Lanes(d)) exchange_from(d, i, out, mid, a, b, k, count);
  for (; i < n; ++i) exchange_from(one, i, out, mid, a, b, k, count);
}

}  // namespace
}  // namespace HWY_NAMESPACE
}  // namespace slicecorr::detail
HWY_AFTER_NAMESPACE();

#if HWY_ONCE

namespace slicecorr::detail {

HWY_EXPORT(exchange_kernel);

void exchange(double* out, const double* mid, const double* const* a, const double* const* b,
              const std::vector<double>& k, std::size_t n) {
  HWY_DYNAMIC_DISPATCH(exchange_kernel)(out, mid, a, b, k.data(), k.size(), n);
}

std::vector<double> exchange_shares(double tau) {
  // The mean over so many waves is exact but for k at that distance, which is nothing.
  constexpr int waves = 256;
  constexpr double least = 1e-8, pi = 3.14159265358979323846;
  std::vector<double> k;
  for (int j = 1; j < waves / 2; ++j) {
    double sum = 0;
    for (int w = 0; w < waves; ++w) {
      const double theta = pi * (w + 0.5) / waves;
      const double s2 = std::sin(theta / 2) * std::sin(theta / 2);
      sum += std::exp(-4 * tau * (s2 + s2 * s2 / 3)) * std::cos(j * theta);
    }
    k.push_back(sum / waves);
  }
  while (!k.empty() && std::abs(k.back()) < least) k.pop_back();
  return k;
}

std::size_t wrapped_cell(std::ptrdiff_t at, std::size_t n, bool walls) {
  const auto size = static_cast<std::ptrdiff_t>(n);
  const std::ptrdiff_t period = walls ? 2 * size : size;
  at = ((at % period) + period) % period;
  return static_cast<std::size_t>(at < size ? at : period - 1 - at);
}

}  // namespace slicecorr::detail

#endif  // HWY_ONCE
