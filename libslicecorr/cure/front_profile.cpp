// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "cure/front_profile.hpp"

#include <algorithm>
#include <array>
#include <numbers>

namespace slicecorr::detail {

namespace {

/// Gauss-Legendre nodes and weights on [-1, 1].
struct Gauss {
  static constexpr int kN = 24;
  std::array<double, kN> x{}, w{};
  Gauss() {
    for (int i = 0; i < kN; ++i) {
      double t = std::cos(std::numbers::pi * (i + 0.75) / (kN + 0.5)), slope = 1;
      for (int round = 0; round < 100; ++round) {
        double p = 1, before = 0;
        for (int k = 1; k <= kN; ++k) {
          const double next = ((2.0 * k - 1.0) * t * p - (k - 1.0) * before) / k;
          before = p;
          p = next;
        }
        slope = kN * (t * p - before) / (t * t - 1.0);
        const double step = p / slope;
        t -= step;
        if (std::abs(step) < 1e-15) break;
      }
      x[static_cast<std::size_t>(i)] = t;
      w[static_cast<std::size_t>(i)] = 2.0 / ((1.0 - t * t) * slope * slope);
    }
  }
};

/// The table ends where the share of UV light in the rate falls to this; beyond it is left out.
constexpr double kShare = 1e-9;
/// Least inhibiting light over blue light that is computed with, so that the logarithm is finite
/// where there is no UV light.
constexpr double kLeastUv = 1e-15;

}  // namespace

double FrontProfile::front_um(double blue, double inhibiting) const {
  if (blue <= 0) return 0;
  return std::log(std::max(inhibiting / blue, kLeastUv)) / slope_;
}

FrontProfile::FrontProfile(const Kinetics& k)
    : m_(k.m), hb_(k.hb_um), slope_(1.0 / k.huv_um - 1.0 / k.hb_um) {
  // A cubic between nodes is off by cell^4 / 384 of the fourth derivative, which is about the
  // fourth power of what the exponents fall by per um: 1e-8 of the rate.
  const double fall = std::max(slope_, 1.0 / hb_) * std::max(1.0, m_);
  const double cell = 1.0 / (20.0 * fall);
  constexpr double most_cells = 1 << 16;
  const double cells = std::min(std::ceil(-std::log(kShare) / (slope_ * cell)), most_cells);
  const auto count = std::max<std::size_t>(static_cast<std::size_t>(cells), kBegin + 1);
  per_um_ = 1.0 / cell;
  end_ = static_cast<double>(count) * cell;

  static const Gauss gauss;
  const auto net = [&](double y) { return std::exp(-y / hb_) * -std::expm1(-slope_ * y); };
  const auto at = [&](double y) { return std::pow(net(y), m_); };
  /// Integral of the rate from 0 to y. With y t^3 for the distance the integrand begins smoothly.
  const auto from_front = [&](double y) {
    double sum = 0;
    for (std::size_t i = 0; i < Gauss::kN; ++i) {
      const double t = 0.5 * (gauss.x[i] + 1.0);
      sum += gauss.w[i] * at(y * t * t * t) * 3.0 * t * t;
    }
    return 0.5 * y * sum;
  };
  const auto between = [&](double from, double to) {
    double sum = 0;
    for (std::size_t i = 0; i < Gauss::kN; ++i) {
      sum += gauss.w[i] * at(0.5 * (from + to + (to - from) * gauss.x[i]));
    }
    return 0.5 * (to - from) * sum;
  };
  const auto slope_at = [&](double y) {
    const double rise =
        -std::exp(-y / hb_) / hb_ + std::exp(-y * (slope_ + 1 / hb_)) * (slope_ + 1 / hb_);
    return m_ * std::pow(net(y), m_ - 1.0) * rise;
  };
  node_.resize(count + 1);
  double rest = hb_ / m_ * std::exp(-m_ * end_ / hb_);
  for (std::size_t i = count + 1; i-- > kBegin;) {
    const double y = static_cast<double>(i) * cell;
    if (i < count) rest += between(y, y + cell);
    node_[i] = {at(y), slope_at(y) * cell, rest, -at(y) * cell};
  }
  whole_ = rest + from_front(static_cast<double>(kBegin) * cell);
  const double first = std::pow(slope_, m_), bends = -m_ * (1.0 / hb_ + 0.5 * slope_);
  begin_[0] = {first, first * bends * cell, first / (m_ + 1.0), first * bends / (m_ + 2.0) * cell};
  for (std::size_t i = 1; i <= kBegin; ++i) {
    const double y = static_cast<double>(i) * cell, sum = from_front(y), rate = at(y);
    const double power = std::pow(y, m_);
    begin_[i] = {rate / power, (slope_at(y) - m_ * rate / y) / power * cell, sum / (y * power),
                 (rate - (m_ + 1.0) * sum / y) / (y * power) * cell};
  }
}

}  // namespace slicecorr::detail
