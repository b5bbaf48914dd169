// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Lamps that fade or shine unevenly, as setups take them. Private to the module.
#pragma once

#include <string>
#include <vector>

#include "slicecorr/setup.hpp"

namespace slicecorr::detail {

/// Shares that a lamp still gives at slices, into `kept` where some are chosen; `name`: of the choice. Throws
/// `InputError` unless all are above 0 and at most 1.
void take_lamp_log(const std::vector<double>& shares, const std::string& name,
                   std::vector<double>& kept);

/// The UV light, where its calibration holds, with which the place of an uneven lamp that gets least of it
/// keeps a dead zone under full light, all others a thicker one. Throws `InfeasibleError` where the
/// lamp can't.
double uv_for_weakest_place(const Setup& setup, double dead_zone_um);

}  // namespace slicecorr::detail
