// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Whether measurements can be what they are taken for. All throw `InputError`.
#pragma once

#include <vector>

#include "slicecorr/resins/spread_fit.hpp"
#include "spread/problem.hpp"

namespace slicecorr::resins {

/// Rows with what printer and resin say of their exposure.
std::vector<WidthProblem::Row> rows_of(const SpreadMeasurements& measured,
                                       const SpreadFitOptions& options);

/// That rows look like copies of others (repeated_rows.hpp), as a sentence; "" where none do.
std::string repeats_of(const SpreadMeasurements& measured);
/// Units that look like millimetres, and lines and gaps that contradict each other.
void check_widths(const SpreadMeasurements& measured, const std::vector<WidthProblem::Row>& rows,
                  const SpreadFitOptions& options);
void check_edges(const SpreadMeasurements& measured);

/// Light that would spread further than the printer's display is wide or high.
void check_reach(const SpreadFit& fit, const SpreadFitOptions& options);

}  // namespace slicecorr::resins
