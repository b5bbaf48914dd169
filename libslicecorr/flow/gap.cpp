// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <algorithm>
#include <cmath>

#include "slicecorr/error.hpp"
#include "slicecorr/flow.hpp"
#include "slicecorr/light_unit.hpp"
#include "slicecorr/supports.hpp"
#include "slicecorr/turbidity.hpp"
#include "slicecorr/units.hpp"

namespace slicecorr {

namespace {

/// Fits tell an exponent to a hundredth or less; one so near to 1 is 1, with the gel dose that takes the
/// same time at the net light of a front, some 10 mW/cm².
void take_exponent(Kinetics& k) {
  constexpr double kNear = 0.0101, kFrontLight = 10;
  if (k.m == 1 || std::abs(k.m - 1) > kNear) return;
  k.critical_dose_prime *= std::pow(kFrontLight, 1 - k.m);
  k.m = 1;
}

}  // namespace

FlowResin flow_resin(const Resin& resin, const std::string& source) {
  if (!(resin.viscosity_pa_s > 0)) {
    throw InputError(
        source.empty() ? resin.name : source, "viscosity_pa_s",
        "is missing; resin flow needs the dynamic viscosity of the liquid resin, Pa·s");
  }
  refuse_law(resin, LawUse::flow);
  refuse_turbidity(resin, "flowing resin");
  refuse_relative(resin, "resin flow");
  FlowResin flowing{make_kinetics(resin, resin.inhibition.has_value(), true), resin.viscosity_pa_s,
                    resin.dose_diffusion_m2_s, resin.inhibitor_life_s};
  take_exponent(flowing.kinetics);
  return flowing;
}

double flow_share(double q) { return q * q * (3 - 2 * q); }

double flow_share_inverse(double share) {
  return 0.5 - std::sin(std::asin(std::clamp(1 - 2 * share, -1.0, 1.0)) / 3);
}

double seconds_under_way(double share_in, double gap_um, double speed_mm_h) {
  if (share_in <= 0) return std::numeric_limits<double>::infinity();
  const double q = flow_share_inverse(share_in);
  const double turns = 1 / (3 * q) - 1.0 / 3 + 2.0 / 9 * std::log((3 - 2 * q) / q);
  return gap_um / (1e4 * units::cm_s_from_mm_h(speed_mm_h)) * turns;
}

}  // namespace slicecorr
