// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Processes that several tests share.
#pragma once

#include <cmath>
#include <vector>

#include "slicecorr/correct.hpp"
#include "slicecorr/cure.hpp"

namespace slicecorr::test {

inline Printer linear_printer(double least, double most, int bit_depth = 8) {
  Printer p;
  p.name = "test";
  p.width_px = p.height_px = 16;
  p.pixel_x_um = p.pixel_y_um = 50;
  p.bit_depth = bit_depth;
  p.calibration = {{0, least}, {static_cast<double>((1 << bit_depth) - 1), most}};
  return p;
}

inline Printer gamma_printer(double least, double most, double gamma, int bit_depth = 8) {
  Printer p = linear_printer(least, most, bit_depth);
  p.calibration.clear();
  const int top = (1 << bit_depth) - 1;
  for (int g = 0; g <= top; ++g) {
    p.calibration.push_back(
        {static_cast<double>(g),
         least + (most - least) * std::pow(g / static_cast<double>(top), gamma)});
  }
  return p;
}

inline Resin resin(double dc_mj_cm3, double ha_um) {
  Resin r;
  r.name = "test";
  r.absorbance_height10_um = ha_um;
  r.critical_dose_mj_cm3 = dc_mj_cm3;
  return r;
}

inline Process process(double speed_mm_h, double omega_max = 1e300) {
  Process p;
  p.speed_mm_h = speed_mm_h;
  p.omega_max = omega_max;
  return p;
}

/// Dissertation figure 2.2: Dc 576 mJ/cm³, hs 50 um, ha 2000 um, 1000 mm/h, 1 to 100 mW/cm².
inline CureModel figure_2_2(double speed_mm_h = 1000) {
  return make_cure_model(linear_printer(1, 100), resin(576, 2000), process(speed_mm_h), 50);
}

/// Coverage of a column from runs [first, last] of full layers.
inline std::vector<std::uint8_t> column(int layers, const std::vector<std::pair<int, int>>& runs) {
  std::vector<std::uint8_t> c(static_cast<std::size_t>(layers), 0);
  for (const auto& [first, last] : runs) {
    for (int n = first; n <= last; ++n) c[static_cast<std::size_t>(n)] = 255;
  }
  return c;
}

/// Features from layer `first` below on, up to `last`: of `thick` layers and more, up to 15 more, `apart`
/// and up to 15 more from each other.
template <typename Random>
std::vector<std::pair<int, int>> random_runs(Random& random, int first, int last, int thick,
                                             int apart) {
  std::vector<std::pair<int, int>> runs;
  for (int n = static_cast<int>(random() % static_cast<unsigned>(first)); n < last - 19;) {
    const int end = n + thick + static_cast<int>(random() % 15);
    runs.push_back({n, end});
    n = end + apart + static_cast<int>(random() % 15);
  }
  runs.back().second = std::min(runs.back().second, last);
  return runs;
}

inline CorrectionPlan plan_for(const CureModel& model, const Process& process, int layers) {
  return {model, process, layers, slices_with_burst(model, layers, layers - 1)};
}

/// Levels of a column, found as a band of one column.
inline std::vector<std::uint8_t> solve_band_of_one(const CorrectionPlan& plan,
                                                   const std::vector<std::uint8_t>& coverage) {
  BandCorrector corrector(plan, 1);
  for (const std::uint8_t c : coverage) corrector.add_layer(&c);
  std::vector<std::uint8_t> band(static_cast<std::size_t>(plan.all_layers));
  corrector.solve([&](int n, const std::uint8_t* level, const std::uint8_t*, bool) {
    band[static_cast<std::size_t>(n)] = *level;
  });
  return band;
}

}  // namespace slicecorr::test
