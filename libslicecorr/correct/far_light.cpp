// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "correct/far_light.hpp"

#include <algorithm>
#include <cmath>

#include "correct/inhibited_plan.hpp"

namespace slicecorr::detail {

NodePowers::NodePowers(const InhibitedKernel& kernel, int last) {
  const Kinetics& k = kernel.kinetics();
  const double halves_per_um = k.m / (k.hb_um * std::log(2.0));
  for (int node = 0; node <= last; ++node) {
    const double x = kernel.place_um(node) * halves_per_um, whole = std::floor(x);
    const double left = std::exp2(whole - x);
    powers_.push_back({left, 1 / left, static_cast<std::size_t>(whole)});
  }
  for (double half = 1; half > 0; half *= 0.5) halves_.push_back(half);
}

FarLight::FarLight(const InhibitedPlan& plan)
    : near_(plan.near),
      levels_(plan.levels),
      count_(static_cast<std::size_t>(plan.all_layers)),
      powers_(*plan.kernel, plan.all_layers) {
  for (int k = 0; k < plan.all_layers; ++k) backs_.push_back(plan.node_back(k));
  const auto rows = static_cast<std::size_t>(levels_) + 2;
  rows_.resize(rows * (count_ + 1), 0.0);
  for (int row = 0; row < levels_ + 2; ++row) {
    double* const sums = &rows_[static_cast<std::size_t>(row) * (count_ + 1)];
    for (int n = plan.all_layers - 1; n >= near_; --n) {
      const int cap = plan.cap_of(n);
      const int level = row < levels_    ? row
                        : row == levels_ ? cap
                                         : std::min(plan.steady_of(n), cap);
      const auto i = static_cast<std::size_t>(n);
      const double own = plan.ratio_of(n) * plan.node_light.last(plan.setting_of(n), level);
      const double after = i + 1 < count_ ? fade(n - near_ + 2, n - near_ + 1) * sums[i + 1] : 0.0;
      sums[i] = own + after;
    }
  }
}

double FarLight::sum(int row, const Slices& slices) const {
  const auto [k, first, end] = slices;
  if (first >= end) return 0;
  const double* const sums = &rows_[static_cast<std::size_t>(row) * (count_ + 1)];
  double sum = fade(first - near_ + 1, k) * sums[first];
  if (static_cast<std::size_t>(end) < count_) sum -= fade(end - near_ + 1, k) * sums[end];
  return backs_[static_cast<std::size_t>(k)] * std::max(0.0, sum);
}

}  // namespace slicecorr::detail
