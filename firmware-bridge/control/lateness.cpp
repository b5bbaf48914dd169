// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <algorithm>

#include "slicecorr/bridge/control.hpp"

namespace slicecorr::bridge {
namespace {

template <typename Bounds, typename Counts>
void count(const Bounds& bounds, Counts& counts, double late, double& sum, double& worst) {
  late = std::max(0.0, late);
  const auto at = std::lower_bound(bounds.begin(), bounds.end(), late) - bounds.begin();
  ++counts[static_cast<std::size_t>(at)];
  sum += late;
  worst = std::max(worst, late);
}

}  // namespace

void Lateness::add_um(double late_um) { count(kBoundsUm, um, late_um, sum_um, worst_um); }
void Lateness::add_deg(double late_deg) { count(kBoundsDeg, deg, late_deg, sum_deg, worst_deg); }
void Lateness::add_ms(double late_ms) { count(kBoundsMs, ms, late_ms, sum_ms, worst_ms); }

}  // namespace slicecorr::bridge
