/// @file statistics.hpp
/// Student's t and Fisher's F, through the regularised incomplete beta function.
///
/// Relative error of probabilities about 1e-13, also far in the tails. Pure functions.
#pragma once

namespace slicecorr::resins {

/// I_x(a, b) for a, b > 0 and 0 <= x <= 1.
double incomplete_beta(double a, double b, double x);

/// P(T <= t) with `freedom` > 0 degrees of freedom.
double student_t_probability(double t, double freedom);
/// t with P(T <= t) = probability, 0 < probability < 1.
double student_t_quantile(double probability, double freedom);

/// P(F > f): small when f is surprisingly large.
double f_exceedance(double f, double freedom1, double freedom2);

}  // namespace slicecorr::resins
