/// @file units.hpp
/// Every conversion between the units of interfaces and those of the physics, in one place.
///
/// Interfaces: heights um, speed mm/h, intensity mW/cm², areal dose mJ/cm², volumetric dose mJ/cm³.
#pragma once

#include <cmath>

namespace slicecorr::units {

inline constexpr double ln10 = 2.302585092994045684;

/// Absorbance height, base e to base 10: intensity falls to 1/e over the one, to 1/10 over the
/// other.
inline double height10_from_e(double height_e_um) { return height_e_um * ln10; }
inline double height_e_from_10(double height10_um) { return height10_um / ln10; }
/// Volumetric dose at the window of an areal dose, for m = 1: Dc,V = Dc,A / he.
inline double volumetric_from_areal(double dose_mj_cm2, double height_e_um) {
  return dose_mj_cm2 / (height_e_um * 1e-4);
}
inline double areal_from_volumetric(double dose_mj_cm3, double height_e_um) {
  return dose_mj_cm3 * (height_e_um * 1e-4);
}
inline double cm_s_from_mm_h(double speed_mm_h) { return speed_mm_h / 36000.0; }
inline double mm_h_from_cm_s(double speed_cm_s) { return speed_cm_s * 36000.0; }
/// Time that the stage needs for one slice.
inline double slice_time_s(double layer_um, double speed_mm_h) {
  return layer_um * 3.6 / speed_mm_h;
}

}  // namespace slicecorr::units
