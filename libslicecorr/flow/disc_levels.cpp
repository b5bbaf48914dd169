// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "flow/disc_levels.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

namespace slicecorr::disc {

namespace {

/// How much of the levels' spacing is that of a cosine: 0 even, 1 all of it.
constexpr double kBunched = 0.7;

/// Integral of e^(-z/height) over z0..z1.
double faded(double height_um, double z0_um, double z1_um) {
  return -height_um * std::exp(-z0_um / height_um) * std::expm1((z0_um - z1_um) / height_um);
}

/// Where a passes 0, um; 0 when it is nowhere below 0 for z > 0.
double no_rate_um(const Kinetics& k, double blue, double uv) {
  if (!(k.beta * uv > blue)) return 0;
  if (blue <= 0) return std::numeric_limits<double>::infinity();
  return std::log(k.beta * uv / blue) / (1 / k.huv_um - 1 / k.hb_um);
}

/// Of f over z0..z1, by Gauss' rule with three places: levels are thin against both heights.
template <class F>
double gauss(double z0, double z1, F f) {
  constexpr std::array<double, 3> place{-0.7745966692414834, 0, 0.7745966692414834};
  constexpr std::array<double, 3> weight{5.0 / 18, 8.0 / 18, 5.0 / 18};
  double sum = 0;
  for (std::size_t i = 0; i < place.size(); ++i) {
    sum += weight[i] * f(0.5 * (z0 + z1) + 0.5 * (z1 - z0) * place[i]);
  }
  return sum * (z1 - z0);
}

}  // namespace

Levels make_levels(int count) {
  Levels l;
  for (int j = 0; j <= count; ++j) {
    const double even = static_cast<double>(j) / count;
    const double bunched = 0.5 * (1 - std::cos(std::numbers::pi * even));
    l.q.push_back(j == count ? 1 : (1 - kBunched) * even + kBunched * bunched);
    l.share.push_back(flow_share(l.q.back()));
    if (j > 0) l.middle.push_back(0.5 * (l.q[l.q.size() - 2] + l.q.back()));
  }
  return l;
}

double rate_at(const Kinetics& k, double blue, double uv, double z_um) {
  return blue * std::exp(-z_um / k.hb_um) - k.beta * uv * std::exp(-z_um / k.huv_um);
}

double dose_rate(const Kinetics& k, double rate) {
  return k.m == 1 ? rate : std::copysign(std::pow(std::abs(rate), k.m), rate);
}

double rate_integral(const Kinetics& k, double blue, double uv, double z0_um, double z1_um) {
  return blue * faded(k.hb_um, z0_um, z1_um) - k.beta * uv * faded(k.huv_um, z0_um, z1_um);
}

double clamped_integral(const Kinetics& k, double blue, double uv, double z0_um, double z1_um) {
  return rate_integral(k, blue, uv, std::clamp(no_rate_um(k, blue, uv), z0_um, z1_um), z1_um);
}

double dose_integral(const Kinetics& k, double blue, double uv, double z0_um, double z1_um) {
  if (k.m == 1) return rate_integral(k, blue, uv, z0_um, z1_um);
  // Apart below and above the place where a is 0, so that each piece is smooth.
  const double none = std::clamp(no_rate_um(k, blue, uv), z0_um, z1_um);
  const auto f = [&](double z) { return dose_rate(k, rate_at(k, blue, uv, z)); };
  return gauss(z0_um, none, f) + gauss(none, z1_um, f);
}

double clamped_dose_integral(const Kinetics& k, double blue, double uv, double z0_um,
                             double z1_um) {
  return dose_integral(k, blue, uv, std::clamp(no_rate_um(k, blue, uv), z0_um, z1_um), z1_um);
}

void level_rates(const Kinetics& k, const Levels& levels, double gap_um, double blue, double uv,
                 bool clamped, LevelRates& out) {
  const int n = levels.count();
  out.store.resize(static_cast<std::size_t>(n));
  out.dose.resize(static_cast<std::size_t>(n));
  for (std::size_t j = 0; j < levels.middle.size(); ++j) {
    const double z0 = gap_um * levels.q[j], z1 = gap_um * levels.q[j + 1], per_um = 1 / (z1 - z0);
    out.store[j] = per_um * rate_integral(k, blue, uv, z0, z1);
    out.dose[j] = clamped    ? per_um * clamped_dose_integral(k, blue, uv, z0, z1)
                  : k.m == 1 ? out.store[j]
                             : per_um * dose_integral(k, blue, uv, z0, z1);
  }
}

}  // namespace slicecorr::disc
