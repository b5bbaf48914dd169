/// Resin 2 of the dissertation's table 4.1.
#pragma once

#include "slicecorr/flow.hpp"

namespace slicecorr::test {

/// hb 408 um, D'c 1600 mJ/cm³, betaV 7.45e-2, huv 38 um, c 1e-10 m²/s, 0.3 Pa·s; areal.
inline FlowResin flow_resin_2() {
  FlowResin r;
  r.kinetics = {.hb_um = 408,
                .m = 1,
                .critical_dose_prime = 1600 * 408e-4,
                .beta = 7.45e-2 * 408 / 38,
                .huv_um = 38};
  r.viscosity_pa_s = 0.3;
  r.diffusion_m2_s = 1e-10;
  return r;
}

}  // namespace slicecorr::test
