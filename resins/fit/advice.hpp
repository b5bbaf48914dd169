// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file advice.hpp
/// What a person should know about a fit, in words and figures.
#pragma once

#include <string>
#include <vector>

#include "fit/diagnosis.hpp"

namespace slicecorr::resins {

/// Why the measurements can't tell a parameter, and what to measure next.
std::string why_unknown(const PreparedFit& prepared, const std::string& name);

/// Warnings about a finished fit: wide intervals, extrapolation, samples that the model does not
/// see gel, dead zones that are steady or not yet, replicates that the curve misses.
std::vector<std::string> advise(const PreparedFit& prepared, const FitResult& result,
                                const Diagnosis& diagnosis);

/// Externally studentised residuals, leverage and Cook's distances into `result.points`, and the
/// outliers among them.
void find_outliers(const PreparedFit& prepared, const Diagnosis& diagnosis, FitResult& result);

}  // namespace slicecorr::resins
