// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Cells that beams are computed on: places along each axis, which need not be next to each other.
#pragma once

#include <array>
#include <cmath>
#include <vector>

#include "slicecorr/tomo/beams.hpp"

namespace slicecorr::tomo::detail {

/// Share of a beam's light that is left at the middles of cells `index` along its axis, of `cells`.
inline std::vector<double> light_left(const BeamSetup& setup, const Beam& beam, int cells,
                                      const std::vector<int>& index) {
  const double before = setup.before_mm(beam.axis, cells);
  std::vector<double> left;
  left.reserve(index.size());
  for (const int i : index) {
    const int nth = beam.from_end ? cells - 1 - i : i;
    left.push_back(std::exp(-setup.alpha_per_mm * (before + (nth + 0.5) * setup.cell_mm)));
  }
  return left;
}

/// What cells beside a lit one get of its light, in the mean over them, when it goes sideways by these
/// Gaussians and a variance: of that itself, of the next one to either side and so on.
struct CellBlur {
  struct Gaussian {
    double weight = 1;
    std::vector<double> shares;
  };
  std::vector<Gaussian> sum;
};
CellBlur cell_blur(const BeamSetup& setup, double path_mm);
/// Of a beam at its cells `index`.
std::vector<CellBlur> blurs_along(const BeamSetup& setup, const Beam& beam, int cells,
                                  const std::vector<int>& index);

/// The cells that decide how good images can be: the box of the part, and the first and the last
/// cells before the walls, where a beam that lights the part is brightest outside of that box. What
/// lies between is on the same rays alone, and darker. Light that goes sideways reaches others, too:
/// then all decide.
struct DecidingCells {
  DecidingCells(const Box<std::uint8_t>& part, const BeamSetup& setup);
  int size(int axis) const {
    return static_cast<int>(index[static_cast<std::size_t>(axis)].size());
  }
  std::array<std::vector<int>, 3> index;  ///< of cells of the volume: along x, y, z
};

}  // namespace slicecorr::tomo::detail
