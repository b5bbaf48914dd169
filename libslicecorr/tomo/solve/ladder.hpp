// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// The contrast ladder of solve.hpp.
#pragma once

#include "slicecorr/tomo/solve.hpp"

namespace slicecorr::tomo::detail {

/// Fills light, dose, rung, bound and history of `solution`; options have been checked.
void run_ladder(const ExecutionContext& context, const Projector& projector, const Target& target,
                const RayTables& optics, const SolveOptions& options, Solution& solution);

}  // namespace slicecorr::tomo::detail
