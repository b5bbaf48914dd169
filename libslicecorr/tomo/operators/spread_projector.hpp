// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Operators of light whose dose spreads in the resin, from those of any light.
///
/// Dose that spreads couples slices, so all of them are one problem: the grid is that of the light
/// with a row for each slice (`TomoGrid::coupled`), unless there is one slice alone.
#pragma once

#include <memory>

#include "slicecorr/tomo/projector.hpp"
#include "tomo/operators/dose_spread.hpp"

namespace slicecorr::tomo::detail {

/// The grid of light whose dose spreads; the same where slices share light already.
TomoGrid spread_grid(const TomoGrid& grid);

/// D = K A^T b and A K: K is symmetric, so that they are exact transposes as those of `of_light` are.
/// `series` is of `spread`; both have the grid of the light.
std::unique_ptr<Projector> make_spread_projector(std::shared_ptr<const Projector> of_light,
                                                 const TomoGrid& grid,
                                                 std::shared_ptr<const DoseSpread> spread,
                                                 SpreadSeries series);

/// The same target on `spread_grid` of its grid.
Target spread_target(const Target& target);
/// Light of `spread_grid(grid)` on `grid`.
Light light_of_slices(Light light, const TomoGrid& grid);

}  // namespace slicecorr::tomo::detail
