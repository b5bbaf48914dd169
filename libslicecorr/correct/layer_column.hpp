// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Columns layer by layer whose doses are sums of light, or, where lifts exchange resin, of the brightest
/// (docs/layerwise.md, docs/lifts.md): any of what is asked of them together.
#pragma once

#include <memory>
#include <vector>

#include "correct/column_solver.hpp"
#include "slicecorr/correct.hpp"

namespace slicecorr::detail {

/// `wants_doses`: doses are wanted of features (`ColumnBounds::wanted`); else they get what just gels
/// or holds. The plan outlives the solver. Caps count where they are of what is left alone.
std::unique_ptr<ColumnSolver> make_layer_column(const CorrectionPlan& plan, bool wants_doses);

/// phi of each slice of a column, at the normal exposure, with any light between black and full.
std::vector<double> solve_layers_exactly(const CorrectionPlan& plan,
                                         const std::vector<CoverageRun>& covered);

}  // namespace slicecorr::detail
