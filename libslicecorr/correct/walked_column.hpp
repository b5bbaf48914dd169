// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Columns of continuous exposure whose doses are sums of light, walked slice by slice
/// (column_walk.hpp): any of what is asked of them together.
#pragma once

#include <memory>
#include <vector>

#include "correct/column_solver.hpp"
#include "slicecorr/correct.hpp"

namespace slicecorr::detail {

/// `wants_doses`: doses are wanted of features (`ColumnBounds::wanted`); else they get as much light as
/// edges leave. The plan outlives the solver. Caps count where they are of what is left alone.
std::unique_ptr<ColumnSolver> make_walked_column(const CorrectionPlan& plan, bool wants_doses);

/// phi, for what a slice counts, of each slice of a column, with any light between black and full.
std::vector<double> solve_walked_exactly(const CorrectionPlan& plan,
                                         const std::vector<CoverageRun>& runs);

}  // namespace slicecorr::detail
