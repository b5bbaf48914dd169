// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// The light of a pattern as it reaches the resin.
#pragma once

#include <vector>

#include "slicecorr/chemistry_pattern.hpp"

namespace slicecorr::detail {

/// Throws `InputError` for what `run_pattern` does not take.
void check_pattern(const Chemistry& c, const LightPattern& pattern, const PatternSetup& setup);

/// Weights of a Gaussian at 0, 1, 2 ... cells, which add up to 1 with both sides; only 1 for no spread.
std::vector<double> spread_weights(double spread_um, double cell_um);

/// Shares of light after its spread, row by row, by the same sides as the resin.
std::vector<float> spread_shares(const std::vector<float>& share, int width, int height,
                                 const PatternSetup& setup, const ExecutionContext& context);

/// Intensity in each cell, mW/cm²: spread, and its mean over the film.
std::vector<float> light_of(const Chemistry& c, const LightPattern& pattern,
                            const PatternSetup& setup, const ExecutionContext& context);

}  // namespace slicecorr::detail
