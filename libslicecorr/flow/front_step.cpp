// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "flow/front_step.hpp"

#include <algorithm>

#include "flow/disc_levels.hpp"

namespace slicecorr::detail {

double front_step_um(const Kinetics& kinetics, double speed_um_s, double gap_um, double blue_mw_cm2,
                     double uv_mw_cm2, double front_dose) {
  constexpr double kMostStepUm = 5, kRelaxation = 0.3;
  const double lacks = kinetics.critical_dose_prime * (1 - front_dose);
  const double net = disc::rate_at(kinetics, blue_mw_cm2, uv_mw_cm2, gap_um);
  const double rate = disc::dose_rate(kinetics, std::max(net, 0.1 * blue_mw_cm2));
  if (rate <= 0) return kMostStepUm;
  return std::clamp(kRelaxation * speed_um_s * lacks / rate, -kMostStepUm, kMostStepUm);
}

}  // namespace slicecorr::detail
