// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file model.hpp
/// Blurred lines, gaps and edges in closed form (spread_fit.hpp).
///
/// Pure functions.
#pragma once

#include <vector>

namespace slicecorr::resins {

/// All that a fit of spread may move.
struct SpreadState {
  double sigma_um = 1, sigma2_um = 0,
         weight2 = 0;  ///< the second Gaussian counts where weight2 > 0
  double scatter = 0;  ///< um² per um
  double dose = 1, dark = 0;
};

/// The normal integral.
double normal_integral(double t);

/// Whether the variances of all Gaussians are 0 or more at this depth, and the rest is in range.
bool holds(const SpreadState& state, double depth_um);

/// Share of the light of a line that is 2 `half_um` wide, at x from its middle, and its slope.
struct Share {
  double value = 0, slope = 0;
};
Share line_share(const SpreadState& state, double depth_um, double half_um, double x_um);

/// Of an edge whose light lies beyond 0: averaged over a box, and another one, and places of some
/// variance about x.
double edge_share(const SpreadState& state, double depth_um, double x_um, double box_um,
                  double other_box_um, double variance_um2);

/// How a row was exposed.
struct Exposure {
  bool gap = false;
  double light = 1;        ///< of lit pixels
  double m = 1;            ///< exponent
  double height_e_um = 0;  ///< absorbance height, base e; 0: not known, and light does not fall
  double depth_um = 0;     ///< infinite: far from the end of a print whose platform moves
  bool moving = false;
};

/// Printed width of a line, or of what stays open of a gap, that is `designed_um` wide. Where
/// nothing is left of it a number below 0, the lower the more is missing; NaN where everything or
/// nothing prints around it.
double printed_width_um(const SpreadState& state, const Exposure& exposure, double designed_um);

/// The narrowest line, or gap, of which something is left; infinite: none within reach.
double narrowest_um(const SpreadState& state, Exposure exposure, bool gap);

}  // namespace slicecorr::resins
