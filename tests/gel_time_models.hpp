// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Resins with a time to gel that several tests share.
#pragma once

#include "models.hpp"
#include "slicecorr/gel_time.hpp"
#include "slicecorr/units.hpp"

namespace slicecorr::test {

/// A hydrogel of PEG diacrylate whose oxygen takes most of the light: A and B by its chemistry.
inline constexpr GelTime kHydrogel{119.238, 4.82633};

/// `g`: at the dose aimed at.
inline Resin gel_time_resin(const GelTime& g, double height_e_um) {
  Resin r;
  r.name = "gel-time";
  r.model = CureModelKind::gel_time;
  r.absorbance_height10_um = units::height10_from_e(height_e_um);
  r.gel_a_mj_cm2 = g.A;
  r.gel_b_sqrt_mw_cm2_s = g.B;
  return r;
}

/// Light of 1 to 100 mW/cm², in which both parts of the time to gel count at 800 mm/h and at 5 s.
inline Resin bright_resin(double height_e_um = 600) { return gel_time_resin({60, 6}, height_e_um); }

}  // namespace slicecorr::test
