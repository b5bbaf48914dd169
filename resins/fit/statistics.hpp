// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file statistics.hpp
/// Student's t and Fisher's F, the way that fits ask for them, by Boost.Math.
///
/// Relative error of probabilities about 1e-13, also far in the tails. Outside of a domain the
/// answer is NaN; nothing throws. Pure functions.
#pragma once

#include <vector>

namespace slicecorr::resins {

/// t with P(T <= t) = probability, 0 < probability < 1, with `freedom` > 0 degrees of freedom.
double student_t_quantile(double probability, double freedom);

/// P(F > f): small when f is surprisingly large.
double f_exceedance(double f, double freedom1, double freedom2);

/// The middle one of at least one value; of an even number the upper of both.
double median(std::vector<double> values);

/// First and second derivative of log Gamma, x > 0.
double digamma(double x);
double trigamma(double x);

/// Variances of groups, drawn to a common one by as much as they differ no more than chance makes
/// them (Smyth 2004): each is (freedom s² + prior_freedom prior) / (freedom + prior_freedom).
struct VariancePrior {
  double variance = 0, freedom = 0;  ///< freedom may be infinite: all groups scatter alike
  double moderated(double group_variance, double group_freedom) const;
};
/// From groups' variances and degrees of freedom, all freedoms > 0, some variance > 0.
VariancePrior variance_prior(const std::vector<double>& variances,
                             const std::vector<double>& freedoms);

}  // namespace slicecorr::resins
