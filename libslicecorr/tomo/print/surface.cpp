// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/tomo/surface.hpp"

#include <array>
#include <cmath>

namespace slicecorr::tomo {

namespace {

constexpr int kPoints = 6;

/// Share of a voxel at or above `gel`, of a dose that is `middle` in it and rises by `slopes` a voxel.
double share_gelled(double middle, const std::array<double, 3>& slopes, double gel) {
  int gelled = 0;
  const auto at = [](int i) { return (i + 0.5) / kPoints - 0.5; };
  for (int i = 0; i < kPoints; ++i) {
    for (int j = 0; j < kPoints; ++j) {
      for (int k = 0; k < kPoints; ++k) {
        gelled += middle + slopes[0] * at(i) + slopes[1] * at(j) + slopes[2] * at(k) >= gel ? 1 : 0;
      }
    }
  }
  return gelled / static_cast<double>(kPoints * kPoints * kPoints);
}

}  // namespace

SurfaceFigures surface_of(const Box<float>& dose, const Box<std::uint8_t>& part,
                          const Box<std::uint8_t>& insert, double voxel_mm, double gel_dose) {
  SurfaceFigures f;
  double sum = 0, squares = 0;
  const double radius = 0.5 * (part.nx - 1) - 1;
  // A single slice has no neighbours along z.
  const bool flat = part.nz == 1;
  for (int z = flat ? 0 : 1; z < (flat ? 1 : part.nz - 1); ++z) {
    for (int y = 1; y < part.ny - 1; ++y) {
      for (int x = 1; x < part.nx - 1; ++x) {
        const std::size_t here = part.at(z, y, x);
        const int wanted = part.values[here];
        if (wanted == 0 || wanted == 255) continue;
        if (std::hypot(x - 0.5 * (part.nx - 1), y - 0.5 * (part.ny - 1)) > radius) continue;
        if (!insert.values.empty() && insert.values[here] > 0) continue;
        const auto d = [&](int dz, int dy, int dx) {
          return static_cast<double>(dose.values[dose.at(z + dz, y + dy, x + dx)]);
        };
        const std::array<double, 3> slopes{0.5 * (d(0, 0, 1) - d(0, 0, -1)),
                                           0.5 * (d(0, 1, 0) - d(0, -1, 0)),
                                           flat ? 0 : 0.5 * (d(1, 0, 0) - d(-1, 0, 0))};
        const double off = share_gelled(d(0, 0, 0), slopes, gel_dose) - wanted / 255.0;
        ++f.voxels;
        sum += off;
        squares += off * off;
      }
    }
  }
  if (f.voxels == 0) return f;
  const double n = static_cast<double>(f.voxels), um = voxel_mm * 1e3;
  f.mean_um = sum / n * um;
  f.rms_um = std::sqrt(squares / n) * um;
  return f;
}

}  // namespace slicecorr::tomo
