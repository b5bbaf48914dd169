// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// The solvers that others published: OSMO, Kelly's projected gradient, filtered back projection.
#pragma once

#include "slicecorr/tomo/solve.hpp"

namespace slicecorr::tomo::detail {

void run_osmo(const ExecutionContext& context, const Projector& projector, const Target& target,
              const SolveOptions& options, Solution& solution);
void run_kelly(const ExecutionContext& context, const Projector& projector, const Target& target,
               const SolveOptions& options, Solution& solution);
void run_fbp(const ExecutionContext& context, const Projector& projector, const Target& target,
             const RayTables& optics, const SolveOptions& options, Solution& solution);

}  // namespace slicecorr::tomo::detail
