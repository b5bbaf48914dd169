// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Layer by layer processes that several tests share.
#pragma once

#include <random>
#include <vector>

#include "models.hpp"
#include "slicecorr/error.hpp"

namespace slicecorr::test {

inline Process layerwise(double exposure_s) {
  Process p;
  p.mode = ExposureMode::layerwise;
  p.exposure_s = exposure_s;
  return p;
}

/// Least exposure of dissertation figure A.7: Dc 576 mJ/cm³, hs 50 um, ha 110 um, 100 mW/cm², by
/// (A.52).
inline double least_exposure_s() {
  return 576 * 110e-4 * std::pow(10, 50.0 / 110) / (100 * std::log(10.0));
}

inline CureModel figure_a_7(double exposure_s = least_exposure_s()) {
  return make_cure_model(linear_printer(1, 100), resin(576, 110), layerwise(exposure_s), 50);
}

/// A feasible process of any kind: layer height, absorbance, exponent, levels, curve, schedule.
struct AnyLayerwise {
  Printer printer;
  Resin resin;
  Process process;
  double layer_um = 50;
  CureModel model() const { return make_cure_model(printer, resin, process, layer_um); }
};

inline AnyLayerwise try_layerwise(std::mt19937& random, int bit_depth) {
  const auto between = [&](double low, double high) {
    return std::uniform_real_distribution(low, high)(random);
  };
  AnyLayerwise any;
  const double black = between(0, 0.4);
  any.printer = random() % 2 ? linear_printer(black, 60, bit_depth)
                             : gamma_printer(black, 60, between(1.5, 3), bit_depth);
  any.layer_um = between(10, 100);
  any.resin = resin(between(100, 900), between(60, 400));
  if (random() % 2) {
    any.resin.model = CureModelKind::kinetic;
    any.resin.m = between(0.6, 1.4);
    any.resin.critical_dose_prime = between(10, 100);
  }
  any.process = layerwise(1.0);
  // From just enough light on.
  const CureModel one = any.model();
  any.process.exposure_s = between(1.01, 3) / (one.phi_max() * one.a);
  if (random() % 2) {
    any.process.bottom_exposure_s = any.process.exposure_s * between(1, 4);
    any.process.bottom_layers = static_cast<int>(random() % 6);
    any.process.fade_layers = static_cast<int>(random() % 6);
  } else if (random() % 3 == 0) {
    for (int n = 0; n < 8; ++n) {
      any.process.layer_exposure_s.push_back(any.process.exposure_s * between(1, 3));
    }
  }
  return any;
}

inline AnyLayerwise any_layerwise(std::mt19937& random, int bit_depth) {
  for (;;) {
    const AnyLayerwise any = try_layerwise(random, bit_depth);
    try {
      check_feasible(any.model(), any.printer, any.process);
      return any;
    } catch (const InfeasibleError&) {
    }
  }
}

/// Features and gaps of random heights, one slice included; with `grey` also partly covered layers.
inline std::vector<std::uint8_t> random_column(std::mt19937& random, int layers, bool grey) {
  std::vector<std::uint8_t> c;
  while (static_cast<int>(c.size()) < layers) {
    const auto value = static_cast<std::uint8_t>(
        grey && random() % 5 == 0 ? 1 + random() % 254 : (random() % 2 ? 255 : 0));
    c.insert(c.end(), 1 + random() % (random() % 3 ? 3 : 12), value);
  }
  c.resize(static_cast<std::size_t>(layers));
  return c;
}

}  // namespace slicecorr::test
