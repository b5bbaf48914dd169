// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// The two resins of the dissertation's table 4.1, areal: D'c hb and beta hb/huv of its volumetric values.
#pragma once

#include "slicecorr/flow.hpp"

namespace slicecorr::test {

inline FlowResin chapter_iv_resin(double hb_um, double huv_um, double dose_mj_cm3, double beta) {
  FlowResin r;
  r.kinetics = {hb_um, 1, dose_mj_cm3 * 1e-4 * hb_um, beta * hb_um / huv_um, huv_um};
  r.viscosity_pa_s = 0.3;
  r.diffusion_m2_s = 1e-10;
  return r;
}
/// Of the prints followed in time (figure 4.3).
inline FlowResin chapter_iv_resin1() { return chapter_iv_resin(600, 50, 1500, 7.58e-2); }
/// Of the light made even (figure 4.4).
inline FlowResin chapter_iv_resin2() { return chapter_iv_resin(408, 38, 1600, 7.45e-2); }

}  // namespace slicecorr::test
