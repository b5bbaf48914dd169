// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Custom Resin 1 of the dissertation, with UV.
#pragma once

#include "slicecorr/process.hpp"
#include "slicecorr/units.hpp"

namespace slicecorr::test {

/// It aims at `factor` gel doses.
inline Resin custom_resin_1(double factor = 1) {
  Resin r;
  r.name = "custom-resin-1";
  r.model = CureModelKind::kinetic;
  r.m = 0.99;
  r.absorbance_height10_um = units::height10_from_e(408);
  r.critical_dose_prime = 64 * factor;
  r.dose_factor = factor;
  r.inhibition = Inhibition{0.73, units::height10_from_e(37.8), 0.99, 0};
  return r;
}

}  // namespace slicecorr::test
