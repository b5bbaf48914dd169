// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "spread/model.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>

#include "support/numbers/bracket.hpp"

namespace slicecorr::resins {

namespace {

double normal_density(double t) { return std::exp(-0.5 * t * t) / std::sqrt(2 * std::numbers::pi); }

/// Its integral from minus infinity to t.
double first_integral(double t) {
  // Far from the edge, where most of a picture lies, doubles show no difference from t and 0: it is
  // 1e-20.
  if (t > 9) return t;
  if (t < -9) return 0;
  return t * normal_integral(t) + normal_density(t);
}

struct Gaussian {
  double sigma = 0, weight = 0;
};
std::array<Gaussian, 2> gaussians_at(const SpreadState& s, double depth_um) {
  const double grown = s.scatter * depth_um;
  return {Gaussian{std::sqrt(std::max(0.0, s.sigma_um * s.sigma_um + grown)), 1 - s.weight2},
          Gaussian{std::sqrt(std::max(0.0, s.sigma2_um * s.sigma2_um + grown)), s.weight2}};
}

/// Of a Gaussian's integral over a box about x.
double boxed_integral(double x, double sigma, double box) {
  if (sigma == 0) {
    if (box == 0) return x > 0 ? 1 : x < 0 ? 0 : 0.5;
    return std::clamp(x / box + 0.5, 0.0, 1.0);
  }
  const double t = x / sigma, b = box / sigma;
  // Its curvature is enough of a narrow box.
  constexpr double narrow = 0.02;
  if (b < narrow) return normal_integral(t) - b * b / 24 * t * normal_density(t);
  return (first_integral(t + b / 2) - first_integral(t - b / 2)) / b;
}

constexpr std::array<double, 4> kNodes = {0.1834346424956498, 0.5255324099163290,
                                          0.7966664774136267, 0.9602898564975363};
constexpr std::array<double, 4> kWeights = {0.3626837833783620, 0.3137066458778873,
                                            0.2223810344533745, 0.1012285362903763};

/// Gauss and Legendre's rule of eight places over [from, to].
template <class F>
void over(double from, double to, const F& f) {
  const double middle = 0.5 * (from + to), half = 0.5 * (to - from);
  for (std::size_t i = 0; i < kNodes.size(); ++i) {
    f(middle - half * kNodes[i], half * kWeights[i]);
    f(middle + half * kNodes[i], half * kWeights[i]);
  }
}

/// Relative dose at x from the middle, and its slope.
Share dose_at(const SpreadState& s, const Exposure& e, double half_um, double x_um) {
  const auto of_depth = [&](double depth_um) {
    Share b = line_share(s, depth_um, half_um, x_um);
    if (e.gap) b = {1 - b.value, -b.slope};
    const double light = s.dark + (e.light - s.dark) * b.value,
                 slope = (e.light - s.dark) * b.slope;
    if (e.m == 1) return Share{light, slope};
    const double power = light > 0 ? std::pow(light, e.m - 1) : 0;
    return Share{light * power, e.m * power * slope};
  };
  const double height = e.height_e_um > 0 ? e.height_e_um / e.m : 0;
  if (!e.moving) {
    const double left = height > 0 ? s.dose * std::exp(-e.depth_um / height) : s.dose;
    const Share d = of_depth(e.depth_um);
    return {left * d.value, left * d.slope};
  }
  const double reach = height > 0 ? e.depth_um / height : std::numeric_limits<double>::infinity();
  if (s.scatter == 0 || height == 0) {
    const double share = s.dose * -std::expm1(-reach);
    const Share d = of_depth(0);
    return {share * d.value, share * d.slope};
  }
  // What lies deeper than 40 heights does not count.
  constexpr double bounds[] = {0, 0.5, 1.5, 3.5, 7, 13, 24, 40};
  Share sum;
  for (std::size_t i = 0; i + 1 < std::size(bounds) && bounds[i] < reach; ++i) {
    over(bounds[i], std::min(bounds[i + 1], reach), [&](double u, double weight) {
      const Share d = of_depth(u * height);
      const double w = s.dose * weight * std::exp(-u);
      sum.value += w * d.value;
      sum.slope += w * d.slope;
    });
  }
  return sum;
}

}  // namespace

double normal_integral(double t) { return 0.5 * std::erfc(-t / std::numbers::sqrt2); }

bool holds(const SpreadState& s, double depth_um) {
  const double least = std::min(
      s.sigma_um * s.sigma_um, s.weight2 > 0 ? s.sigma2_um * s.sigma2_um : s.sigma_um * s.sigma_um);
  return s.sigma_um >= 0 && s.weight2 >= 0 && s.weight2 < 1 &&
         (s.weight2 == 0 || s.sigma2_um > s.sigma_um) && least + s.scatter * depth_um >= 0 &&
         s.dose > 0 && s.dark >= 0 && s.dark < 1;
}

Share line_share(const SpreadState& s, double depth_um, double half_um, double x_um) {
  Share sum;
  for (const auto& [sigma, weight] : gaussians_at(s, depth_um)) {
    if (weight == 0) continue;
    if (sigma == 0) {
      sum.value += weight * (std::abs(x_um) < half_um ? 1 : std::abs(x_um) > half_um ? 0 : 0.5);
      continue;
    }
    const double left = (x_um + half_um) / sigma, right = (x_um - half_um) / sigma;
    sum.value += weight * (normal_integral(left) - normal_integral(right));
    sum.slope += weight * (normal_density(left) - normal_density(right)) / sigma;
  }
  return sum;
}

double edge_share(const SpreadState& s, double depth_um, double x_um, double box_um,
                  double other_box_um, double variance_um2) {
  double sum = 0;
  for (const Gaussian& g : gaussians_at(s, depth_um)) {
    if (g.weight == 0) continue;
    double wide = std::sqrt(g.sigma * g.sigma + variance_um2);
    // A narrow box is as good as a Gaussian of its variance.
    constexpr double narrow = 0.1;
    if (other_box_um <= narrow * wide) {
      wide = std::sqrt(wide * wide + other_box_um * other_box_um / 12);
      sum += g.weight * boxed_integral(x_um, wide, box_um);
      continue;
    }
    over(-0.5, 0.5, [&](double at, double part) {
      sum += g.weight * part * boxed_integral(x_um + at * other_box_um, wide, box_um);
    });
  }
  return sum;
}

double printed_width_um(const SpreadState& s, const Exposure& e, double designed_um) {
  const double half = 0.5 * designed_um;
  // Beyond so much all light of the line is gone, for doubles.
  const double depth = e.moving ? 40 * e.height_e_um / e.m : e.depth_um;
  double widest = 0;
  for (const auto& [sigma, weight] : gaussians_at(s, depth)) {
    if (weight > 0) widest = std::max(widest, sigma);
  }
  double outer = 2 * half + 40 * widest;
  const double beside = dose_at(s, e, half, outer).value, middle = dose_at(s, e, half, 0).value;
  // A line's light falls from its middle, a gap's rises.
  const double sign = e.gap ? -1 : 1;
  if (!(sign * (1 - beside) > 0)) return std::numeric_limits<double>::quiet_NaN();
  if (!(sign * (middle - 1) > 0)) {
    return -2 * std::hypot(half, widest) * std::sqrt(std::abs(1 - middle));
  }
  double inner = 0, x = half;
  for (int i = 0; i < 200 && outer - inner > 1e-13 * outer; ++i) {
    const Share d = dose_at(s, e, half, x);
    const double over_it = sign * (d.value - 1);
    (over_it > 0 ? inner : outer) = x;
    if (over_it == 0) break;
    const double next = x - (d.value - 1) / d.slope;
    const bool newton = d.slope != 0 && next > inner && next < outer;
    const double moved = newton ? std::abs(next - x) : outer;
    x = newton ? next : 0.5 * (inner + outer);
    if (moved <= 1e-14 * std::max(x, widest)) break;
  }
  return 2 * x;
}

double narrowest_um(const SpreadState& s, Exposure e, bool gap) {
  e.gap = gap;
  const double high = 40 * std::max({s.sigma_um, s.weight2 > 0 ? s.sigma2_um : 0.0, 1e-3});
  if (!(printed_width_um(s, e, high) > 0)) return std::numeric_limits<double>::infinity();
  return halved({0, high}, 60, [&](double um) { return !(printed_width_um(s, e, um) > 0); }).high;
}

}  // namespace slicecorr::resins
