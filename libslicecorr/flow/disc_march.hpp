// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file disc_march.hpp
/// The march from the edge inwards. Private to the module.
#pragma once

#include <string>
#include <vector>

#include "slicecorr/flow_disc.hpp"

namespace slicecorr::disc {

/// k of tau = -k ln r.
inline double turns_of(DiscShape shape) { return shape == DiscShape::disc ? 2 : 1; }

/// Where the march stops by: tau_i ~ i^3 from the edge, where Y grows like the root of tau, to
/// `least_r`.
struct Places {
  std::vector<double> tau;
  std::vector<double> r;  ///< descending from 1
};
Places make_places(DiscShape shape, const DiscGrid& grid);

/// Values in the order of the places as a curve.
RadialCurve as_curve(const Places& places, const std::vector<double>& value);

/// Whether dose is linear in light: signed with m = 1. (Clamped dose is not, but it is marched so.)
bool is_linear(const FlowResin& resin);

/// hf(r) = min over r' of h(r') + slope |r - r'|; r ascends, in the same unit as h.
void limit_slope(const std::vector<double>& r, double slope, std::vector<double>& h);

/// Marches all lights at once; no checks.
std::vector<DiscDose> march(const FlowResin& resin, const DiscPrint& print,
                            const RadialCurve& gap_um, const std::vector<DiscLight>& lights,
                            const DiscGrid& grid);

/// @name Refusals: `InputError` with the key, `InfeasibleError` where nothing inhibits
/// @{
void check_positive(double value, const std::string& key);
void check_resin(const FlowResin& resin);
void check_print(const DiscPrint& print);
void check_grid(const DiscGrid& grid);
void check_gap(const RadialCurve& gap_um);
void check_light(const DiscLight& light);
/// There is UV light somewhere.
void check_inhibited(const DiscLight& light);
void check_front(const RadialCurve& front);
[[noreturn]] void refuse(const std::string& key, const std::string& what);
/// @}

}  // namespace slicecorr::disc
