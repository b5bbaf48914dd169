// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <algorithm>
#include <cmath>

#include "slicecorr/simulate.hpp"

namespace slicecorr {

StationaryFronts simulate_stationary(const Kinetics& kinetics, double blue_mw_cm2, double uv_mw_cm2,
                                     double time_s) {
  StationaryFronts fronts;
  fronts.blue_mw_cm2 = blue_mw_cm2;
  fronts.uv_mw_cm2 = uv_mw_cm2;
  fronts.first = first_gel(kinetics, blue_mw_cm2, uv_mw_cm2);
  fronts.dead_zone_um = steady_dead_zone_um(kinetics, blue_mw_cm2, uv_mw_cm2);
  fronts.window_s = window_time_s(kinetics, blue_mw_cm2, uv_mw_cm2);
  const double start = fronts.first.time_s;
  if (!(start <= time_s)) return fronts;

  constexpr int steps = 200;
  std::vector<double> times{start};
  for (int i = 1; i <= steps; ++i) {
    const double t = i < steps ? time_s * i / steps : time_s;
    if (t > start) times.push_back(t);
    // Close together at first: both fronts start off vertically.
    const double u = static_cast<double>(i) / steps;
    if (i < steps / 2) times.push_back(start + (time_s - start) * u * u * u);
  }
  // The front meets the window at an angle.
  if (fronts.window_s > start && fronts.window_s < time_s) times.push_back(fronts.window_s);
  std::sort(times.begin(), times.end());
  times.erase(std::unique(times.begin(), times.end()), times.end());
  for (const double t : times) {
    if (const auto f = curing_fronts(kinetics, blue_mw_cm2, uv_mw_cm2, t)) {
      fronts.points.push_back({t, f->front_um, f->back_um});
    }
  }
  return fronts;
}

}  // namespace slicecorr
