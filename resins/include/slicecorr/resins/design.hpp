/// @file design.hpp
/// What a resin and a printer allow, and the absorber that a wish needs.
#pragma once

#include <string>
#include <vector>

#include "slicecorr/process.hpp"

namespace slicecorr::resins {

/// A wish for continuous printing.
struct Wish {
  double speed_mm_h = 0;    ///< > 0
  double tolerance_um = 0;  ///< height error that is allowed without and with correction
  double layer_um = 50;
  double blue_mw_cm2 = 0;   ///< greatest intensity of the printer, > 0
  double black_mw_cm2 = 0;  ///< least intensity of the printer, >= 0
  double dead_zone_um = 0;  ///< wanted at the window; 0: not asked
  double uv_mw_cm2 = 0;     ///< greatest UV intensity; 0: no lamp
};

/// What to do and why, in figures.
struct Recommendation {
  bool feasible = false;
  double height_e_um = 0, height10_um = 0;                 ///< absorbance height to formulate for
  double least_height10_um = 0, greatest_height10_um = 0;  ///< range that meets the wish
  double absorber_factor = 1;  ///< absorbance over that of the resin now
  double fastest_mm_h = 0;     ///< with that height
  double uncorrected_error_um = 0, corrected_error_um = 0;
  double uv_needed_mw_cm2 = 0;
  std::vector<std::string> reasons;  ///< sentences
};
Recommendation recommend(const Resin& resin, const Printer& printer, const Wish& wish);

}  // namespace slicecorr::resins
