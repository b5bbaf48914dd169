// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "fit/statistics.hpp"

#include <algorithm>
#include <boost/math/distributions/fisher_f.hpp>
#include <boost/math/distributions/students_t.hpp>
#include <boost/math/policies/policy.hpp>
#include <boost/math/special_functions/digamma.hpp>
#include <boost/math/special_functions/trigamma.hpp>
#include <cmath>
#include <limits>

#include "support/numbers/bracket.hpp"

namespace slicecorr::resins {

namespace {

namespace policies = boost::math::policies;

/// What lies outside of a function's domain gives NaN: no exception, no errno. In double, because
/// long double costs a multiple and no figure shows it.
using Quiet = policies::policy<
    policies::domain_error<policies::ignore_error>, policies::pole_error<policies::ignore_error>,
    policies::overflow_error<policies::ignore_error>,
    policies::underflow_error<policies::ignore_error>,
    policies::denorm_error<policies::ignore_error>,
    policies::rounding_error<policies::ignore_error>,
    policies::evaluation_error<policies::ignore_error>,
    policies::indeterminate_result_error<policies::ignore_error>, policies::promote_double<false>>;
using StudentT = boost::math::students_t_distribution<double, Quiet>;
using FisherF = boost::math::fisher_f_distribution<double, Quiet>;

}  // namespace

double median(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

double digamma(double x) { return boost::math::digamma(x, Quiet()); }

double trigamma(double x) { return boost::math::trigamma(x, Quiet()); }

double VariancePrior::moderated(double group_variance, double group_freedom) const {
  if (std::isinf(freedom)) return variance;
  return (group_freedom * group_variance + freedom * variance) / (group_freedom + freedom);
}

VariancePrior variance_prior(const std::vector<double>& variances,
                             const std::vector<double>& freedoms) {
  const double n = static_cast<double>(variances.size());
  double squares = 0, freedom = 0;
  for (std::size_t i = 0; i < variances.size(); ++i) {
    squares += freedoms[i] * variances[i];
    freedom += freedoms[i];
  }
  const double pooled = squares / freedom;
  // The logarithm of a variance has a known mean and variance when all scatter alike; what it has
  // beyond that is the spread of the true variances. Replicates that agree by luck, or to the last
  // digit of the gauge, must not count for more than that.
  double mean = 0, spread = 0, by_chance = 0;
  std::vector<double> logs;
  for (std::size_t i = 0; i < variances.size(); ++i) {
    const double half = 0.5 * freedoms[i];
    logs.push_back(std::log(std::max(variances[i], 1e-5 * pooled)) - digamma(half) +
                   std::log(half));
    mean += logs.back() / n;
    by_chance += trigamma(half) / n;
  }
  for (const double l : logs) spread += (l - mean) * (l - mean) / std::max(1.0, n - 1);
  const double excess = spread - by_chance;
  if (n < 2 || !(excess > 0)) return {pooled, std::numeric_limits<double>::infinity()};
  // trigamma(half) = excess: it falls from infinity to 0.
  double high = 1;
  while (trigamma(high) > excess && high < 1e8) high *= 2;
  const double half =
      halved({1e-6, high}, 100, [&](double x) { return trigamma(x) > excess; }).middle();
  return {std::exp(mean + digamma(half) - std::log(half)), 2 * half};
}

double student_t_quantile(double probability, double freedom) {
  if (!(probability > 0 && probability < 1)) return std::numeric_limits<double>::quiet_NaN();
  return boost::math::quantile(StudentT(freedom), probability);
}

double f_exceedance(double f, double freedom1, double freedom2) {
  if (std::isnan(f)) return f;
  if (f <= 0) return 1;
  if (std::isinf(f)) return 0;
  return boost::math::cdf(boost::math::complement(FisherF(freedom1, freedom2), f));
}

}  // namespace slicecorr::resins
