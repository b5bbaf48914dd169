// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Parts and setups for tests of beams.
#pragma once

#include <cmath>
#include <functional>
#include <vector>

#include "slicecorr/tomo/beams.hpp"

namespace slicecorr::test {

/// Cells are part where `inside(x, y, z)`.
inline tomo::Box<std::uint8_t> part_of(int nx, int ny, int nz,
                                       const std::function<bool(int, int, int)>& inside) {
  tomo::Box<std::uint8_t> part{nz, ny, nx, {}};
  for (int z = 0; z < nz; ++z) {
    for (int y = 0; y < ny; ++y) {
      for (int x = 0; x < nx; ++x) part.values.push_back(inside(x, y, z) ? 255 : 0);
    }
  }
  return part;
}

inline tomo::Box<std::uint8_t> ball_part(int n) {
  const double middle = 0.5 * (n - 1);
  return part_of(n, n, n, [&](int x, int y, int z) {
    const double u = x - middle, v = y - middle, w = z - middle;
    return u * u + v * v + w * w <= 0.25 * n * n;
  });
}

/// Three bars of 2 cells with gaps of 4 along each axis: part where two of three coordinates are in
/// a bar.
inline tomo::Box<std::uint8_t> lattice_part() {
  return part_of(14, 14, 14,
                 [](int x, int y, int z) { return (x % 6 < 2) + (y % 6 < 2) + (z % 6 < 2) >= 2; });
}

/// A cube of 6 cells with a hollow of 2 in its middle, and a cell of resin around it.
inline tomo::Box<std::uint8_t> hollow_part() {
  const auto hollow = [](int i) { return i == 3 || i == 4; };
  const auto cube = [](int i) { return i >= 1 && i < 7; };
  return part_of(8, 8, 8, [&](int x, int y, int z) {
    return cube(x) && cube(y) && cube(z) && !(hollow(x) && hollow(y) && hollow(z));
  });
}

/// Four of the eight octants, no two of which share a face.
inline tomo::Box<std::uint8_t> octants_part() {
  return part_of(4, 4, 4, [](int x, int y, int z) { return (x / 2 + y / 2 + z / 2) % 2 == 0; });
}

inline tomo::BeamSetup beam_setup(int beams, double cell_mm = 1, double alpha_per_mm = 0,
                                  tomo::BeamImages images = tomo::BeamImages::silhouette) {
  tomo::BeamSetup setup;
  setup.beams = tomo::beams_of(beams);
  setup.cell_mm = cell_mm;
  setup.alpha_per_mm = alpha_per_mm;
  setup.images = images;
  return setup;
}

}  // namespace slicecorr::test
