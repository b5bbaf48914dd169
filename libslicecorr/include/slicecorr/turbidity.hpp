// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file turbidity.hpp
/// Resin that scatters light forward in single kicks (`Resin::turbidity`, Henyey and Greenstein): what
/// of a thin beam is where after a way l. With mu_s = albedo times extinction, tau = mu_s l and
/// c = (1 - g) l, the spread of the beam has the transform
///   S(k) = exp(-tau + tau (1 - e^(-ck)) / (ck)),
/// as each kick is nearly a Cauchy law of width 1 - g in the plane, times e^(-mu_a l) for what is
/// absorbed. exp(-tau) of it goes straight on. Light that is scattered far to the side or back is not in it.
///
/// Plain functions, thread-safe.
#pragma once

#include <vector>

#include "slicecorr/process.hpp"

namespace slicecorr {

/// Throws `InputError` where the resin is turbid: that is not counted in `what`, a word or a few.
void refuse_turbidity(const Resin& resin, const char* what);

/// S(k), k in 1/mm.
double turbid_transform(const Turbidity& turbidity, double way_mm, double per_mm);

/// Shares of the light by the Gaussians, of these standard deviations (mm, the first 0: straight on), that
/// are nearest to S after a way: none below 0, together 1.
std::vector<double> turbid_shares(const Turbidity& turbidity, double way_mm,
                                  const std::vector<double>& sigmas_mm);

/// (1 - g) tau: how far it is from the law above. Up to 0.2 doses of a Monte Carlo are higher by a few in a
/// hundred; beyond 0.4 the law is none.
double turbid_reach(const Turbidity& turbidity, double way_mm);
inline constexpr double kDoubtfulTurbidity = 0.2, kMostTurbidity = 0.4;

}  // namespace slicecorr
