// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file estimate.hpp
/// The steps of a fit after its set-up: solving, reciprocity, bootstrap.
#pragma once

#include <optional>
#include <vector>

#include "fit/diagnosis.hpp"

namespace slicecorr::resins {

/// Solves with the loss of the options; settles the scale of a robust loss and, for joint fits
/// without given weights, the weights of the two kinds of measurement.
Solution estimate(PreparedFit& prepared, const FitOptions& options);

/// Weights of the kinds in a joint fit are the inverse of their scatter, which the fit itself
/// tells: sum of squares over number minus summed leverage, until it settles.
struct KindScatter {
  double cured_um = 0, dead_zone_um = 0;
};
KindScatter scatter_of_kinds(const Problem& problem, const Diagnosis& diagnosis);

/// Interval of an active unknown in which the cost, with the others fitted again, stays within
/// what `t` standard errors would make of it were the law linear (likelihood profile; Bates and
/// Watts, Nonlinear Regression Analysis, 6.1). An end that lies beyond a bound is that bound.
std::array<double, 2> profile_interval(const PreparedFit& prepared, const Solution& solution,
                                       const Diagnosis& diagnosis, std::size_t active_index,
                                       double t);

/// Jacobs against kinetic on the cured heights; nothing where they can't tell.
std::optional<Reciprocity> test_reciprocity(const PreparedFit& prepared, const Solution& solution,
                                            const Diagnosis& diagnosis,
                                            const std::vector<FitPoint>& points);

/// Fits of resampled residuals: value by unknown, one row for each resampling that could be fitted.
/// Residuals are divided by sqrt(1 - leverage), centred, and drawn within their kind: cases can't
/// be drawn within triplicates without making the scatter a third too small.
std::vector<std::vector<double>> bootstrap(const PreparedFit& prepared, const Solution& solution,
                                           const Diagnosis& diagnosis, int count,
                                           std::uint64_t seed, const ExecutionContext& context);

}  // namespace slicecorr::resins
