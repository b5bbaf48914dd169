// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "descent.hpp"

#include <algorithm>
#include <cmath>
#include <deque>

namespace slicecorr::detail {
namespace {

constexpr std::size_t kMemory = 12;
constexpr int kRest = 10;  ///< steps over which progress is judged
/// Progress below which it ends, of the value: what is left is worth a tenth of a percent of a section.
constexpr double kProgress = 3e-4;
constexpr double kArmijo = 1e-4;

using Vector = std::vector<double>;

double dot(const Vector& a, const Vector& b) {
  double sum = 0;
  for (std::size_t i = 0; i < a.size(); ++i) sum += a[i] * b[i];
  return sum;
}

struct Pair {
  Vector step, change;
};

/// Of a vector only what may move.
double dot(const Vector& a, const Vector& b, const std::vector<char>& free) {
  double sum = 0;
  for (std::size_t i = 0; i < a.size(); ++i) sum += free[i] ? a[i] * b[i] : 0;
  return sum;
}

/// -H g of the numbers that may move, H from the steps so far.
Vector direction(const Vector& gradient, const std::deque<Pair>& pairs,
                 const std::vector<char>& free) {
  Vector d(gradient.size());
  for (std::size_t i = 0; i < d.size(); ++i) d[i] = free[i] ? -gradient[i] : 0;
  std::vector<double> alpha(pairs.size(), 0.0), rho(pairs.size(), 0.0);
  double scale = 0;
  for (std::size_t k = pairs.size(); k-- > 0;) {
    const double curve = dot(pairs[k].step, pairs[k].change, free);
    const double size = dot(pairs[k].change, pairs[k].change, free);
    if (!(curve > 1e-12 * size)) continue;
    if (scale == 0) scale = curve / size;
    rho[k] = 1 / curve;
    alpha[k] = rho[k] * dot(pairs[k].step, d, free);
    for (std::size_t i = 0; i < d.size(); ++i) d[i] -= alpha[k] * pairs[k].change[i];
  }
  // Without curvature the first step is a hundredth of the range.
  double largest = 0;
  for (std::size_t i = 0; i < d.size(); ++i) {
    d[i] = free[i] ? d[i] : 0;
    largest = std::max(largest, std::abs(d[i]));
  }
  if (scale == 0) scale = largest > 0 ? 0.01 / largest : 1;
  for (double& v : d) v *= scale;
  for (std::size_t k = 0; k < pairs.size(); ++k) {
    if (rho[k] == 0) continue;
    const double beta = rho[k] * dot(pairs[k].change, d, free);
    for (std::size_t i = 0; i < d.size(); ++i) d[i] += (alpha[k] - beta) * pairs[k].step[i];
  }
  for (std::size_t i = 0; i < d.size(); ++i) d[i] = free[i] ? d[i] : 0;
  return d;
}

}  // namespace

Descent descend(Vector x, const Vector& least, const Slope& slope, int iterations) {
  const std::size_t n = x.size();
  Vector gradient(n), next(n), next_gradient(n), steepest(n);
  std::deque<Pair> pairs;
  std::deque<double> values;
  std::vector<char> free(n);
  for (std::size_t i = 0; i < n; ++i) x[i] = std::clamp(x[i], least[i], 1.0);
  Descent at{std::move(x), 0, 0};
  at.value = slope(at.x, gradient);
  for (; at.iterations < iterations; ++at.iterations) {
    for (std::size_t i = 0; i < n; ++i) {
      free[i] = !(at.x[i] <= least[i] && gradient[i] >= 0) && !(at.x[i] >= 1 && gradient[i] <= 0);
    }
    Vector d = direction(gradient, pairs, free);
    if (!(dot(d, gradient) < 0)) {
      if (pairs.empty()) break;
      pairs.clear();
      continue;
    }
    double value = at.value, length = 1;
    bool lower = false;
    for (int half = 0; half < 30 && !lower; ++half) {
      double gain = 0;
      for (std::size_t i = 0; i < n; ++i) {
        next[i] = std::clamp(at.x[i] + length * d[i], least[i], 1.0);
        gain += gradient[i] * (next[i] - at.x[i]);
      }
      value = slope(next, next_gradient);
      lower = value <= at.value + kArmijo * gain;
      if (!lower) length *= 0.4;
    }
    if (!lower) {
      if (pairs.empty()) break;
      pairs.clear();
      continue;
    }
    Pair pair{Vector(n), Vector(n)};
    for (std::size_t i = 0; i < n; ++i) {
      pair.step[i] = next[i] - at.x[i];
      pair.change[i] = next_gradient[i] - gradient[i];
    }
    pairs.push_back(std::move(pair));
    if (pairs.size() > kMemory) pairs.pop_front();
    at.x.swap(next);
    gradient.swap(next_gradient);
    values.push_back(at.value);
    at.value = value;
    if (values.size() < kRest) continue;
    if (values.front() - value <= kProgress * values.front()) break;
    values.pop_front();
  }
  return at;
}

}  // namespace slicecorr::detail
