// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// How a dead zone's front is sought. Private to the module.
#pragma once

#include "slicecorr/flow.hpp"

namespace slicecorr::detail {

/// How far a front goes towards dose 1 in a round of the fixed point, um, at most 5: a share of what
/// it would have to wait, rising at S, for the dose that lacks. Where UV light takes most of the rate,
/// or all of it, the dose below comes with the flow and rises with z all the same: there a tenth of
/// the blue light stands for the rate.
double front_step_um(const Kinetics& kinetics, double speed_um_s, double gap_um, double blue_mw_cm2,
                     double uv_mw_cm2, double front_dose);

}  // namespace slicecorr::detail
