// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/turbidity.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstddef>

#include "slicecorr/error.hpp"

namespace slicecorr {

namespace {

/// Waves that a fit looks at, 1/mm, each so much shorter than the one before.
constexpr int kWaves = 80;
constexpr double kLongest = 0.02, kShorter = 1.12;
/// Weight of all light's sum, and passes of the descent along one share after another.
constexpr double kOfSum = 30;
constexpr int kPasses = 3000;

double scattered_per_mm(const Turbidity& t) { return t.albedo * t.extinction_per_cm / 10; }

}  // namespace

void refuse_turbidity(const Resin& resin, const char* what) {
  if (!resin.turbidity.scatters()) return;
  throw InputError(
      resin.name, "extinction_per_cm",
      fmt::format("is not counted in {}; expected a resin without it (scatter_um2_per_um "
                  "is of light that scatters a little)",
                  what));
}

double turbid_transform(const Turbidity& t, double way_mm, double per_mm) {
  const double tau = scattered_per_mm(t) * way_mm, x = (1 - t.anisotropy) * way_mm * per_mm;
  return std::exp(-tau + tau * (x > 1e-6 ? -std::expm1(-x) / x : 1 - x / 2));
}

double turbid_reach(const Turbidity& t, double way_mm) {
  return t.scatters() ? (1 - t.anisotropy) * scattered_per_mm(t) * way_mm : 0;
}

std::vector<double> turbid_shares(const Turbidity& t, double way_mm,
                                  const std::vector<double>& sigmas_mm) {
  const std::size_t n = sigmas_mm.size() - 1;
  const double straight = std::exp(-scattered_per_mm(t) * std::max(0.0, way_mm));
  std::vector<double> shares(n + 1, 0);
  shares[0] = straight;
  if (!(1 - straight > 1e-9)) {
    shares[0] = 1;
    return shares;
  }
  // Least squares on the transform, the normal equations' way: shares below 0 become 0.
  std::vector<double> matrix(n * n, kOfSum * kOfSum), right(n, kOfSum * kOfSum * (1 - straight));
  for (int wave = 0; wave < kWaves; ++wave) {
    const double k = kLongest * std::pow(kShorter, wave);
    const double wanted = turbid_transform(t, way_mm, k) - straight;
    std::vector<double> of(n);
    for (std::size_t i = 0; i < n; ++i) {
      of[i] = std::exp(-0.5 * sigmas_mm[i + 1] * k * sigmas_mm[i + 1] * k);
    }
    for (std::size_t i = 0; i < n; ++i) {
      right[i] += of[i] * wanted;
      for (std::size_t j = 0; j < n; ++j) matrix[i * n + j] += of[i] * of[j];
    }
  }
  std::vector<double> x(n, (1 - straight) / static_cast<double>(n));
  for (int pass = 0; pass < kPasses; ++pass) {
    for (std::size_t i = 0; i < n; ++i) {
      double sum = right[i];
      for (std::size_t j = 0; j < n; ++j) sum -= matrix[i * n + j] * x[j];
      x[i] = std::max(0.0, x[i] + sum / matrix[i * n + i]);
    }
  }
  double all = 0;
  for (const double v : x) all += v;
  for (std::size_t i = 0; i < n; ++i) shares[i + 1] = x[i] * (1 - straight) / all;
  return shares;
}

}  // namespace slicecorr
