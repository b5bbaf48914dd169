// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What a single corrected column prints.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

#include "models.hpp"
#include "slicecorr/predict.hpp"

namespace slicecorr::test {

/// Ic is 1 mW/cm², so that intensities are phi.
inline CureModel model_of(double layer_um, double ha_um, double phi_max, double contrast,
                          double gamma, int bits) {
  return make_cure_model(gamma_printer(phi_max / contrast, phi_max, gamma, bits), resin(36, ha_um),
                         process(1000), layer_um);
}

struct PrintedColumn {
  std::uint64_t undercured = 0, cured_through = 0;
  std::uint64_t wrong() const { return undercured + cured_through; }
  double largest_um = 0;      ///< error of edges that are not above a gap of one slice
  double above_slits_um = 0;  ///< shortfall of those that are
  double least_contrast = 1;
};

inline PrintedColumn print(const CureModel& model, const Process& process,
                           const std::vector<std::uint8_t>& design) {
  const int layers = static_cast<int>(design.size());
  const auto plan = plan_for(model, process, layers);
  const auto levels = solve_column(plan, design);
  const PixelCurve curve = pixel_curve(model);
  BandPredictor predictor(model, curve, plan.all_layers, 1);
  PrintedColumn printed;
  predictor.tell_edges([&](std::size_t, int node, bool upper, double um) {
    const auto n = static_cast<std::size_t>(node);
    const bool above_slit = !upper && n + 1 < design.size() && design[n + 1] != 0;
    if (above_slit && um < 0) {
      printed.above_slits_um = std::max(printed.above_slits_um, -um);
    } else {
      printed.largest_um = std::max(printed.largest_um, std::abs(um));
    }
  });
  const int count = static_cast<int>(model.level_phi.size());
  for (int n = plan.all_layers; n-- > 0;) {
    const auto k = static_cast<std::size_t>(n);
    const auto pixel = static_cast<std::uint8_t>(pixel_of_level(levels[k], count));
    const std::uint8_t cover = n < layers ? design[k] : 0;
    predictor.add_slice(n, &pixel, &cover);
  }
  const Prediction p = predictor.finish(0, 0, 1);
  printed.undercured = p.undercure_voxels;
  printed.cured_through = p.cure_through_voxels;
  if (p.gaps > 0) printed.least_contrast = p.gap_contrast.least();
  return printed;
}

}  // namespace slicecorr::test
