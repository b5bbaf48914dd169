// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Bounds of contrast, which a dose proves: with lo = (1 - D)+ on gel, hi = (D - rho_c)+ on void and
/// delta >= 0 the least with A(hi + delta void) >= A lo on every ray, any b >= 0 has
///   min_gel D <= max_void D (sum hi + delta n_void) / sum lo.
/// Slices are independent, so the least bound of a slice is the part's. Rays are compared with a
/// margin of 1e-4 for the projector's single precision.
///
/// Where cells have bands L to U of their own, lo = (L - D)+ and hi = (D - U)+, and delta goes to all that
/// have a most:  min D / L <= max D / U (sum U (hi + delta)) / sum L lo.
#pragma once

#include <vector>

#include "slicecorr/tomo/projection.hpp"

namespace slicecorr::tomo::detail {

/// Of these slices, or all that share light; infinite for others and where the dose proves nothing.
std::vector<double> contrast_bounds(const ExecutionContext& context, const Projector& projector,
                                    const CellKinds& cells, const Array<float>& dose, double rung,
                                    const std::vector<int>& slices);

/// The same of light by the weights of `prover`, which has the same cells: `projector` is quicker and
/// only finds hi. Their lanes may differ, and their light.
std::vector<double> proven_bounds(const ExecutionContext& context, const Projector& projector,
                                  const Projector& prover, const CellKinds& cells,
                                  const Array<float>& dose, double rung,
                                  const std::vector<int>& slices);

}  // namespace slicecorr::tomo::detail
