// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file units.hpp
/// Every conversion between the units of interfaces and those of the physics, in one place.
///
/// Interfaces: heights um, speed mm/h, intensity mW/cm², areal dose mJ/cm², volumetric dose mJ/cm³.
/// Pure and thread-safe; nothing is checked, and nothing throws.
#pragma once

#include <cmath>

namespace slicecorr::units {

inline constexpr double kLn10 = 2.302585092994045684;

/// Absorbance height, base e to base 10: intensity falls to 1/e over the one, to 1/10 over the
/// other.
inline double height10_from_e(double height_e_um) { return height_e_um * kLn10; }
inline double height_e_from_10(double height10_um) { return height10_um / kLn10; }
/// Volumetric dose at the window of an areal dose, for m = 1: Dc,V = Dc,A / he.
inline double volumetric_from_areal(double dose_mj_cm2, double height_e_um) {
  return dose_mj_cm2 / (height_e_um * 1e-4);
}
inline double areal_from_volumetric(double dose_mj_cm3, double height_e_um) {
  return dose_mj_cm3 * (height_e_um * 1e-4);
}
/// Dose analogue D' and inhibition constant, areal to volumetric (dissertation B.7): D'V,c = D'A,c
/// / hb^m in (mW/cm³)^m·s, betaV = betaA huv / hb.
inline double volumetric_prime_from_areal(double dose_prime, double height_e_um, double m) {
  return dose_prime / std::pow(height_e_um * 1e-4, m);
}
inline double areal_prime_from_volumetric(double dose_prime, double height_e_um, double m) {
  return dose_prime * std::pow(height_e_um * 1e-4, m);
}
inline double volumetric_beta_from_areal(double beta, double hb_um, double huv_um) {
  return beta * huv_um / hb_um;
}
inline double areal_beta_from_volumetric(double beta, double hb_um, double huv_um) {
  return beta * hb_um / huv_um;
}
/// Absorbance of a film (base 10) and the absorbance height (base e) of its resin.
inline double height_e_from_absorbance(double film_um, double absorbance) {
  return film_um / (kLn10 * absorbance);
}
/// Absorption, 1/cm, of an absorbance height, both base e; the other way round the same.
inline double absorption_per_cm_from_height_e(double height_e_um) { return 1e4 / height_e_um; }
inline double height_e_from_absorption_per_cm(double per_cm) { return 1e4 / per_cm; }
inline double cm_s_from_mm_h(double speed_mm_h) { return speed_mm_h / 36000.0; }
inline double mm_h_from_cm_s(double speed_cm_s) { return speed_cm_s * 36000.0; }
/// Time that the stage needs for one slice.
inline double slice_time_s(double layer_um, double speed_mm_h) {
  return layer_um * 3.6 / speed_mm_h;
}

}  // namespace slicecorr::units
