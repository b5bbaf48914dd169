// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// How light spreads on its way through a resin that scatters it: by another kernel from each distance.
#pragma once

#include <limits>
#include <vector>

#include "cure/light_spread.hpp"
#include "slicecorr/orientation.hpp"
#include "slicecorr/process.hpp"

namespace slicecorr::detail {

/// How light goes through a slice of a resin that scatters it.
struct ScatterWay {
  double um2_per_um = 0;   ///< as `Resin::scatter_um2_per_um`
  double height_e_um = 0;  ///< absorbance height
  double slice_um = 0;
  bool layerwise = false;  ///< the window stands a slice away, it does not come up to the node
  double pixel_x_um = 0, pixel_y_um = 0;
};

/// How the light of slices at some distances spreads on its way to a node: those from `from` slices
/// further on (0: the node's own) up to `to` slices, exclusive.
struct DistanceBlur {
  int from = 0, to = 0;
  LightBlur blur{};
};

/// The kernel by depth of a resin that scatters, right also where light begins and ends, and for any m: light
/// that has come through d um is that of the window and a Gaussian of kappa d, integrated over pixels, and what
/// the slices of a distance give is that of their depths, weighted as light fades. Distances share a kernel where
/// that changes doses by 2e-3 at the most. The first is
/// a slice's own, and each begins where the one before it ends. `bath`: slices from which no light comes
/// any more; 0: there is no end, and the last distance has none (`kNoEnd`). Empty without scatter.
inline constexpr int kNoEnd = std::numeric_limits<int>::max();
std::vector<DistanceBlur> distance_blurs(const LightSpread& spread, const ScatterWay& way, int bath,
                                         const Turn& to_display = {});

}  // namespace slicecorr::detail
