#include "fit/statistics.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace slicecorr::resins {

namespace {

constexpr double kPi = 3.14159265358979323846;

/// log Gamma without the global sign that std::lgamma writes to: safe in threads.
double log_gamma(double x) {
  int sign = 0;
  return ::lgamma_r(x, &sign);
}

/// The continued fraction of I_x(a, b) by Lentz's method; converges fast for x < (a+1)/(a+b+2).
double beta_fraction(double a, double b, double x) {
  constexpr double tiny = 1e-300;
  const auto not_zero = [](double v) { return std::abs(v) < tiny ? tiny : v; };
  double c = 1;
  double d = 1 / not_zero(1 - (a + b) * x / (a + 1));
  double value = d;
  // The number of terms grows with the root of a and b: enough for 1e8 degrees of freedom.
  for (int i = 1; i < 100000; ++i) {
    const double even = i * (b - i) * x / ((a + 2 * i - 1) * (a + 2 * i));
    d = 1 / not_zero(1 + even * d);
    c = not_zero(1 + even / c);
    value *= d * c;
    const double odd = -(a + i) * (a + b + i) * x / ((a + 2 * i) * (a + 2 * i + 1));
    d = 1 / not_zero(1 + odd * d);
    c = not_zero(1 + odd / c);
    const double factor = d * c;
    value *= factor;
    if (std::abs(factor - 1) < 1e-16) break;
  }
  return value;
}

/// I_x(a, b) where both x and 1 - x are known exactly.
double incomplete_beta(double a, double b, double x, double one_minus_x) {
  if (x <= 0) return 0;
  if (one_minus_x <= 0) return 1;
  const double front = std::exp(log_gamma(a + b) - log_gamma(a) - log_gamma(b) + a * std::log(x) +
                                b * std::log(one_minus_x));
  if (x < (a + 1) / (a + b + 2)) return front * beta_fraction(a, b, x) / a;
  return 1 - front * beta_fraction(b, a, one_minus_x) / b;
}

/// P(T > t) for t >= 0, accurate where it is small.
double upper_tail(double t, double freedom) {
  const double square = t * t;
  return 0.5 * incomplete_beta(0.5 * freedom, 0.5, freedom / (freedom + square),
                               square / (freedom + square));
}

}  // namespace

double incomplete_beta(double a, double b, double x) { return incomplete_beta(a, b, x, 1 - x); }

double digamma(double x) {
  double value = 0;
  for (; x < 10; x += 1) value -= 1 / x;
  const double y = 1 / (x * x);
  return value + std::log(x) - 0.5 / x -
         y * (1.0 / 12 - y * (1.0 / 120 - y * (1.0 / 252 - y * (1.0 / 240 - y / 132))));
}

double trigamma(double x) {
  double value = 0;
  for (; x < 10; x += 1) value += 1 / (x * x);
  const double y = 1 / (x * x);
  return value + 1 / x + 0.5 * y +
         y / x * (1.0 / 6 - y * (1.0 / 30 - y * (1.0 / 42 - y * (1.0 / 30 - y * 5 / 66))));
}

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
  double low = 1e-6, high = 1;
  while (trigamma(high) > excess && high < 1e8) high *= 2;
  for (int i = 0; i < 100; ++i) {
    const double middle = 0.5 * (low + high);
    (trigamma(middle) > excess ? low : high) = middle;
  }
  const double half = 0.5 * (low + high);
  return {std::exp(mean + digamma(half) - std::log(half)), 2 * half};
}

double student_t_probability(double t, double freedom) {
  if (std::isnan(t)) return t;
  if (std::isinf(t)) return t > 0 ? 1 : 0;
  const double tail = upper_tail(std::abs(t), freedom);
  return t > 0 ? 1 - tail : tail;
}

double student_t_quantile(double probability, double freedom) {
  if (!(probability > 0 && probability < 1)) return std::numeric_limits<double>::quiet_NaN();
  if (probability == 0.5) return 0;
  const double tail = std::min(probability, 1 - probability);
  // Bracket the quantile, then halve: the tail is monotone, so nothing can go wrong.
  double low = 0, high = 1;
  while (upper_tail(high, freedom) > tail && high < 1e150) {
    low = high;
    high *= 2;
  }
  double t = 0.5 * (low + high);
  const double log_scale =
      log_gamma(0.5 * (freedom + 1)) - log_gamma(0.5 * freedom) - 0.5 * std::log(freedom * kPi);
  for (int i = 0; i < 200 && low < high; ++i) {
    const double excess = upper_tail(t, freedom) - tail;
    if (excess == 0) break;
    (excess > 0 ? low : high) = t;
    const double density = std::exp(log_scale - 0.5 * (freedom + 1) * std::log1p(t * t / freedom));
    double next = t + excess / density;
    if (!(next > low && next < high)) next = 0.5 * (low + high);
    const bool settled = std::abs(next - t) <= 1e-15 * std::abs(t);
    t = next;
    if (settled) break;
  }
  return probability < 0.5 ? -t : t;
}

double f_exceedance(double f, double freedom1, double freedom2) {
  if (std::isnan(f)) return f;
  if (f <= 0) return 1;
  if (std::isinf(f)) return 0;
  const double sum = freedom2 + freedom1 * f;
  return incomplete_beta(0.5 * freedom2, 0.5 * freedom1, freedom2 / sum, freedom1 * f / sum);
}

}  // namespace slicecorr::resins
