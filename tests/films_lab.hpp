// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file films_lab.hpp
/// A printer whose light nobody knows, its resin, and somebody with calipers.
#pragma once

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <string>
#include <vector>

namespace slicecorr::test {

/// A printer file of which nobody knows the light.
inline constexpr const char* kUnlitPrinter =
    "name = \"dark\"\n[display]\nwidth_px = 1600\nheight_px = 1200\npixel_um = 50.0\n[blue]\n"
    "wavelength_nm = 405\n# Nobody knows.\ncalibration = \"to be measured\"\n[stage]\n"
    "travel_mm = 100\n";

/// What is hidden: by the definition of the working curve, without anything of the library.
struct HiddenPrinter {
  double ha_um = 150, gel_s = 0.8;
  std::vector<double> share;  ///< of each level, 0..255; rises to 1

  /// Any curve that rises: a power of the level, bent twice.
  static HiddenPrinter random(std::mt19937& random) {
    const auto between = [&](double low, double high) {
      return std::uniform_real_distribution(low, high)(random);
    };
    HiddenPrinter p;
    p.ha_um = between(80, 400);
    p.gel_s = between(0.4, 1.5);
    const double power = between(1, 2.8), bend = between(-0.12, 0.12), at = between(0.5, 2);
    for (int g = 0; g <= 255; ++g) {
      const double x = g / 255.0;
      p.share.push_back(std::pow(x, power) * std::exp(bend * std::sin(3.14159 * at * (1 - x))));
    }
    for (std::size_t g = 1; g < p.share.size(); ++g) {
      p.share[g] = std::max(p.share[g], p.share[g - 1]);
    }
    for (double& s : p.share) s /= p.share.back();
    return p;
  }
  double film_um(int level, double exposure_s) const {
    return ha_um * std::log10(share[static_cast<std::size_t>(level)] * exposure_s / gel_s);
  }
};

/// What calipers read of a film: anywhere within `off_um` of what it is, to the 10 um that they show;
/// 0: no film, or one too thin to be peeled.
inline double read_by_calipers(double film_um, double off_um, std::mt19937& random) {
  constexpr double thinnest_um = 30, step_um = 10;
  if (!(film_um >= thinnest_um)) return 0;
  const double reads = film_um + std::uniform_real_distribution(-off_um, off_um)(random);
  return off_um > 0 ? step_um * std::round(reads / step_um) : reads;
}

}  // namespace slicecorr::test
