// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file lab_columns.hpp
/// Columns of parts that labs print layer by layer, and where their edges come to lie, by the definition of
/// doses alone: nothing of the library.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <random>
#include <vector>

namespace slicecorr::test {

struct LabColumn {
  std::vector<std::uint8_t> coverage;
  std::vector<int> begins;  ///< nodes where a feature begins over a gap
};

/// Features of 8 layers and more, 12 and more apart: thicker than what light that lingers reaches.
inline LabColumn random_lab_column(std::mt19937& random) {
  constexpr int layers = 120;
  LabColumn part;
  part.coverage.assign(layers, 0);
  int n = 4 + static_cast<int>(random() % 8);
  std::fill_n(part.coverage.begin(), n, std::uint8_t{255});
  while (n < layers - 30) {
    n += 12 + static_cast<int>(random() % 12);
    part.begins.push_back(n);
    const int end = std::min(layers, n + 8 + static_cast<int>(random() % 12));
    std::fill(part.coverage.begin() + n, part.coverage.begin() + end, std::uint8_t{255});
    n = end;
  }
  return part;
}

constexpr int kLabPoints = 100;  ///< of a layer, where prints are looked at

/// Where the upper edge of a feature lies that begins at node u, um above it, below as negative: points of
/// the column are followed through all exposures, each lift exchanging `x` of what is liquid. `phi`: of
/// each layer at its window, in critical doses.
inline double lab_edge_um(const std::vector<double>& phi, double ha_um, double layer_um, int u,
                          double x) {
  const auto gels = [&](double z) {
    double dose = 0;
    for (int n = static_cast<int>(std::floor(z + 1e-9)); n < static_cast<int>(phi.size()); ++n) {
      dose = (1 - x) * dose +
             phi[static_cast<std::size_t>(n)] * std::pow(10, -(n + 1 - z) * layer_um / ha_um);
      if (dose >= 1) return true;
    }
    return false;
  };
  // From well inside the feature towards the platform.
  int z = (u + 4) * kLabPoints;
  while (z > 0 && gels(static_cast<double>(z - 1) / kLabPoints)) --z;
  return (u - static_cast<double>(z) / kLabPoints) * layer_um;
}

}  // namespace slicecorr::test
