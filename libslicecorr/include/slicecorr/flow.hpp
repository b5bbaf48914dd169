// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file flow.hpp
/// Resin that flows in the gap between window and part while the part rises (dissertation chapter IV,
/// in the limit of a thin gap).
///
/// z is the distance from the window, h the gap's thickness, q = z/h, S the speed. The share of the
/// gap's flow that passes below q is F(q) = 3q² - 2q³, and F is the clock of what flows: along a path
/// dx/dlnF = Q/S and dt = h dq/(S F), where Q is the flow through the whole gap per width.
///
/// Plain functions, thread-safe. Heights are base e.
#pragma once

#include <string>

#include "slicecorr/kinetics.hpp"
#include "slicecorr/process.hpp"

namespace slicecorr {

/// A resin that flows. Rates and doses are those of `kinetics.hpp`, areal: the volumetric ones of
/// chapter IV are these over hb.
struct FlowResin {
  Kinetics kinetics;          ///< under UV light, at the dose that the correction aims at
  double viscosity_pa_s = 0;  ///< > 0
  double diffusion_m2_s = 0;  ///< c, of dose and inhibitor, >= 0
  double inhibitor_life_s = std::numeric_limits<double>::infinity();  ///< tau_z, >= 0; 0: the clamp
};

/// What a resin file says of its flow. Throws `InputError` naming `source`, where the resin comes from
/// (empty: its name alone), and the key where the viscosity is missing or the resin has no dose. An
/// exponent within 0.01 of 1 counts as 1, with the gel dose of the same time at 10 mW/cm²: from 1 to
/// 100 mW/cm² that is within 2.4 %.
FlowResin flow_resin(const Resin& resin, const std::string& source = {});

/// F(q), q in 0..1: 0 at the window, 1 at the part.
double flow_share(double q);
/// q with F(q) = `share`, which is in 0..1.
double flow_share_inverse(double share);

/// How long resin is under way that gels at a point of a disc or a strip, s: `share_in` is F where
/// it came in, in (0, 1] (r̄² of a disc, x̄ of a strip). Infinite where `share_in` is 0.
double seconds_under_way(double share_in, double gap_um, double speed_mm_h);

/// Most that one can draw on a liquid, Pa: 1 bar, from which on it cavitates.
inline constexpr double kCavitationPa = 1e5;

}  // namespace slicecorr
