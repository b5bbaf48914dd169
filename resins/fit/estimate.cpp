// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "fit/estimate.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "fit/figure_text.hpp"
#include "fit/statistics.hpp"
#include "slicecorr/error.hpp"

namespace slicecorr::resins {

namespace {

// Efficiency 95 % against normal scatter (Holland and Welsch 1977).
constexpr double kSoftL1Tuning = 1.345, kCauchyTuning = 2.385;

std::vector<double> residuals_at(const Problem& problem, const std::vector<double>& inner) {
  std::vector<double> residual(problem.observations.size());
  if (!problem.residuals(inner.data(), residual.data(), nullptr)) return {};
  return residual;
}

/// Rounding of the weighted heights: no scatter can be seen below.
double rounding_of(const Problem& problem) {
  double greatest = 0;
  for (const Observation& o : problem.observations) {
    greatest = std::max(greatest, std::abs(o.weight * o.measured_um));
  }
  return std::max(1e-12 * greatest, std::numeric_limits<double>::min());
}

/// True when least squares have one minimum whatever the start: the law is linear in disguise, and
/// no bound cuts through.
bool is_convex(const PreparedFit& s, const FitOptions& options) {
  const bool linear = s.model == FitModel::jacobs || s.model == FitModel::kinetic ||
                      s.model == FitModel::dead_zone_steady;
  return linear && options.bounds.empty() && options.fixed.empty();
}

Solution solve_with_loss(PreparedFit& s, const FitOptions& options,
                         std::vector<std::vector<double>> starts) {
  Problem& problem = s.problem;
  problem.loss = Loss::none;
  if (is_convex(s, options)) starts.resize(1);
  Solution plain = solve_best(problem, starts);
  if (options.loss == Loss::none) return plain;

  const double tuning = options.loss == Loss::cauchy ? kCauchyTuning : kSoftL1Tuning;
  const auto scale_at = [&](const Solution& at) {
    const double sigma = robust_sigma(residuals_at(problem, at.inner), problem.unknowns.size());
    return std::max(sigma, 1e3 * rounding_of(problem));
  };
  problem.loss_scale = options.loss_scale_um;
  Solution robust = plain;
  if (!(options.loss_scale_um > 0)) {
    // Least squares are drawn to outliers and see too much scatter: soft-l1 brings it down first.
    for (int round = 0; round < 4; ++round) {
      problem.loss = Loss::none;
      problem.loss_scale = scale_at(robust) * kSoftL1Tuning;
      problem.loss = Loss::soft_l1;
      if (auto next = solve(problem, robust.inner)) robust = std::move(*next);
    }
    problem.loss_scale = scale_at(robust) * tuning;
  }
  problem.loss = options.loss;
  starts.insert(starts.begin(), robust.inner);
  Solution best = solve_best(problem, starts);
  best.iterations += plain.iterations;
  return best;
}

/// SplitMix64: any start gives a good sequence, so every resampling has its own.
class Random {
 public:
  explicit Random(std::uint64_t seed) : state_(seed) {}
  std::uint64_t next() {
    state_ += 0x9E3779B97F4A7C15ULL;
    std::uint64_t z = state_;
    z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9ULL;
    z = (z ^ (z >> 27)) * 0x94D049BB133111EBULL;
    return z ^ (z >> 31);
  }
  /// From 0 to n - 1; the bias of n / 2^64 does not matter.
  std::size_t below(std::size_t n) { return static_cast<std::size_t>(next() % n); }

 private:
  std::uint64_t state_;
};

/// Akaike's criterion for small samples; infinite where the sample is too small for it.
double aicc(double squares, double n, double parameters) {
  const double k = parameters + 1;
  if (n - k - 1 <= 0) return std::numeric_limits<double>::quiet_NaN();
  return n * std::log(squares / n) + 2 * k + 2 * k * (k + 1) / (n - k - 1);
}

/// Between the cured heights that two laws give for the observations, um.
double greatest_difference(const Problem& problem, const Slots& a, const Slots& b) {
  double worst_um = 0;
  for (const Observation& o : problem.observations) {
    worst_um = std::max(worst_um,
                        std::abs(cured_height(a, o.exposure).um - cured_height(b, o.exposure).um));
  }
  return worst_um;
}

/// `half`: of the confidence interval of m, `error`: its standard error; `worst_um`: how far
/// Jacobs' law is off.
std::string verdict_of(const Reciprocity& r, double half, double error, double worst_um) {
  if (half > 0.5) {
    // No reason to doubt it, and none to believe in it.
    return fmt::format(
        "The measurements can't tell whether reciprocity holds: m is {:.3g}, but anything from "
        "{:.3g} to {:.3g} fits (95 %).",
        r.m, r.m_ci95[0], r.m_ci95[1]);
  }
  const std::string figures =
      fmt::format("m = {} ({} to {}; F = {:.3g}, p = {:.2g})", figure(r.m, error),
                  figure(r.m_ci95[0], error), figure(r.m_ci95[1], error), r.f, r.p_value);
  const double gain = r.aic_jacobs - r.aic_kinetic;
  std::string by_aic = "samples are too few for AICc";
  if (std::isfinite(gain)) {
    by_aic = fmt::format("AICc prefers {} by {:.3g}", gain > 0 ? "the kinetic law" : "Jacobs' law",
                         std::abs(gain));
  }
  const auto dose_at_a_quarter = [](double m) { return std::pow(0.25, 1 - m); };
  if (r.holds && std::max(1 - r.m_ci95[0], r.m_ci95[1] - 1) > 0.2) {
    return fmt::format(
        "The measurements neither contradict reciprocity nor tell it: {} does not differ from 1, and "
        "{}; but as far as anybody knows the same height needs {:.2f} to {:.2f} times the dose at a "
        "quarter of the intensity (95 %).",
        figures, by_aic, dose_at_a_quarter(r.m_ci95[0]), dose_at_a_quarter(r.m_ci95[1]));
  }
  if (r.holds) {
    return fmt::format(
        "Reciprocity holds: {} does not differ from 1, and {}. Only the dose counts, as in Jacobs' "
        "law.",
        figures, by_aic);
  }
  return fmt::format(
      "Reciprocity does not hold: {} differs from 1, and {}. At a quarter of the intensity the "
      "same height needs {:.2f} times the dose; Jacobs' law is off by up to {:.3g} um at the doses "
      "measured.",
      figures, by_aic, dose_at_a_quarter(r.m), worst_um);
}

}  // namespace

KindScatter scatter_of_kinds(const Problem& problem, const Diagnosis& d) {
  std::array<double, 2> squares{}, freedom{};
  std::array<std::vector<double>, 2> residual;
  for (std::size_t i = 0; i < problem.observations.size(); ++i) {
    const Observation& o = problem.observations[i];
    const auto k = static_cast<Eigen::Index>(i);
    const double r = d.residual(k) / o.weight;
    squares[o.is_dead_zone] += r * r;
    freedom[o.is_dead_zone] += 1 - d.leverage(k);
    residual[o.is_dead_zone].push_back(r);
  }
  std::array<double, 2> sigma{};
  for (const std::size_t kind : {std::size_t{0}, std::size_t{1}}) {
    if (freedom[kind] > 0.5) sigma[kind] = std::sqrt(squares[kind] / freedom[kind]);
    if (problem.loss != Loss::none) sigma[kind] = robust_sigma(residual[kind], 0);
  }
  return {sigma[0], sigma[1]};
}

Solution estimate(PreparedFit& prepared, const FitOptions& options) {
  Problem& problem = prepared.problem;
  const bool weigh_kinds = prepared.model == FitModel::joint && options.weights == Weights::none;
  if (!weigh_kinds) return solve_with_loss(prepared, options, prepared.starts(options.starts));

  // Cured heights scatter by tens of um, dead zones by a few: with equal weights the former would
  // drown the latter. The first guess of their scatter is a share of their spread.
  std::array<double, 2> sum{}, squares{}, count{};
  for (const Observation& o : problem.observations) {
    sum[o.is_dead_zone] += o.measured_um;
    squares[o.is_dead_zone] += o.measured_um * o.measured_um;
    count[o.is_dead_zone] += 1;
  }
  std::array<double, 2> sigma{};
  for (const std::size_t k : {std::size_t{0}, std::size_t{1}}) {
    const double variance = squares[k] / count[k] - std::pow(sum[k] / count[k], 2);
    sigma[k] = std::sqrt(std::max(variance, 1e-6 * squares[k] / count[k]));
  }
  const auto weigh = [&] {
    for (Observation& o : problem.observations) o.weight = 1 / sigma[o.is_dead_zone];
    normalise_weights(problem);
  };
  weigh();
  Solution solution = solve_with_loss(prepared, options, prepared.starts(options.starts));
  int iterations = solution.iterations;
  // A median moves in steps: with a robust loss nothing settles to the last digit.
  const bool robust = options.loss != Loss::none;
  const int rounds = robust ? 6 : 30;
  const double settled = robust ? 1e-3 : 1e-9;
  for (int round = 0; round < rounds; ++round) {
    const Diagnosis d = diagnose(problem, solution);
    if (d.singular) break;
    const KindScatter scatter = scatter_of_kinds(problem, d);
    // Measurements without scatter, made for a check, still need finite weights.
    const double least = 1e-9 * std::max(sigma[0], sigma[1]);
    const double ratio = sigma[1] / sigma[0];
    sigma = {std::max(scatter.cured_um, least), std::max(scatter.dead_zone_um, least)};
    if (std::abs(sigma[1] / sigma[0] / ratio - 1) < settled) break;
    weigh();
    solution = solve_with_loss(prepared, options, {solution.inner});
    iterations += solution.iterations;
  }
  solution.iterations = iterations;
  return solution;
}

std::array<double, 2> profile_interval(const PreparedFit& prepared, const Solution& solution,
                                       const Diagnosis& d, std::size_t active_index, double t) {
  const std::size_t which = d.active[active_index];
  const Unknown unknown = prepared.problem.unknowns[which];
  const double best = solution.inner[which], stderr_inner = d.stderr_inner(active_index);
  const auto column = d.unscaled.col(static_cast<Eigen::Index>(active_index));
  PreparedFit held = prepared;
  held.hold(unknown.name, unknown.value(best));
  held.problem.tolerance = std::max(held.problem.tolerance, 1e-7);
  std::vector<double> others = solution.inner, direction;
  others.erase(others.begin() + static_cast<std::ptrdiff_t>(which));
  for (std::size_t i = 0; i < solution.inner.size(); ++i) {
    if (i == which) continue;
    const auto k = std::find(d.active.begin(), d.active.end(), i) - d.active.begin();
    const bool moves = k < static_cast<std::ptrdiff_t>(d.active.size());
    direction.push_back(moves ? column(k) / column(static_cast<Eigen::Index>(active_index)) : 0);
  }
  const std::vector<double> others_at_best = others;
  double others_for = best;
  /// Distance from the optimum in standard errors, as the cost sees it. The others start where they
  /// were, moved along the line that the covariance gives. Where the cost then rises much more than
  /// that line says, the solver may have stopped in a bend of the valley, or beside it: other
  /// starts tell. An end that is too near would be a promise that nobody can keep.
  const auto distance = [&](double inner) {
    for (const Slot slot : unknown.slots) held.problem.fixed[slot] = unknown.value(inner);
    std::vector<double> start = others;
    for (std::size_t i = 0; i < start.size(); ++i) start[i] += (inner - others_for) * direction[i];
    auto refit = solve(held.problem, start);
    const auto seen = [&](const std::optional<Solution>& at) {
      return at ? std::sqrt(std::max(0.0, 2 * (at->cost - solution.cost)) / d.variance)
                : std::numeric_limits<double>::infinity();
    };
    constexpr double as_expected = 1.3;
    if (seen(refit) > as_expected * std::abs(inner - best) / stderr_inner) {
      std::vector<std::vector<double>> starts = held.starts(4);
      starts.push_back(others);
      starts.push_back(others_at_best);
      for (const auto& other : starts) {
        auto again = solve(held.problem, other);
        if (again && (!refit || again->cost < refit->cost)) refit = std::move(again);
      }
    }
    if (!refit) return std::numeric_limits<double>::infinity();
    others = refit->inner;
    others_for = inner;
    return seen(refit);
  };
  const auto end_towards = [&](double sign) {
    const double bound = unknown.inner(sign < 0 ? unknown.low : unknown.high);
    const auto limited = [&](double step) {
      const double inner = best + sign * step;
      return sign < 0 ? std::max(inner, bound) : std::min(inner, bound);
    };
    others = others_at_best;
    others_for = best;
    double near = 0, near_distance = 0;
    double far = t * stderr_inner, far_distance = distance(limited(far));
    for (int round = 0; far_distance < t; ++round) {
      // Where the cost hardly rises the end is as good as nowhere.
      if (round == 20 || limited(far) == bound) return bound;
      near = far;
      near_distance = far_distance;
      far *= std::clamp(1.1 * t / far_distance, 1.1, 3.0);
      far_distance = distance(limited(far));
    }
    // The distance is close to proportional: false position, with halves where it stalls.
    for (int i = 0; i < 40 && far - near > 1e-3 * stderr_inner; ++i) {
      double share = (t - near_distance) / (far_distance - near_distance);
      if (!std::isfinite(far_distance) || i % 3 == 2) share = 0.5;
      const double middle = near + std::clamp(share, 0.02, 0.98) * (far - near);
      const double seen = distance(limited(middle));
      if (std::abs(seen - t) < 1e-3) return limited(middle);
      (seen < t ? near : far) = middle;
      (seen < t ? near_distance : far_distance) = seen;
    }
    return limited(0.5 * (near + far));
  };
  return {unknown.value(end_towards(-1)), unknown.value(end_towards(1))};
}

std::optional<Reciprocity> test_reciprocity(const PreparedFit& prepared, const Solution& solution,
                                            const Diagnosis& d,
                                            const std::vector<FitPoint>& points) {
  // Both laws on the cured heights, with the weights that the fit came to.
  PreparedFit kinetic;
  kinetic.model = FitModel::kinetic;
  kinetic.problem.tolerance = prepared.problem.tolerance;
  for (const auto& p : parameters_of(FitModel::kinetic, {})) {
    kinetic.problem.unknowns.push_back(p.unknown);
  }
  std::vector<double> ln_blue;
  double greatest = 0;
  for (std::size_t i = 0; i < prepared.problem.observations.size(); ++i) {
    Observation o = prepared.problem.observations[i];
    if (o.is_dead_zone) continue;
    const FitPoint& point = points[prepared.point_of[i]];
    if (!(point.blue_mw_cm2 > 0 && point.exposure_s > 0)) return std::nullopt;
    const double r = d.residual(static_cast<Eigen::Index>(i));
    o.weight *= std::sqrt(rho(prepared.problem.loss, prepared.problem.loss_scale, r * r)[1]);
    greatest = std::max(greatest, std::abs(o.weight * o.measured_um));
    ln_blue.push_back(o.exposure.ln_blue);
    kinetic.problem.observations.push_back(o);
  }
  const double n = static_cast<double>(ln_blue.size());
  if (n < 4 || count_different(ln_blue) < 2) return std::nullopt;
  kinetic.start = d.law;
  PreparedFit jacobs = kinetic;
  jacobs.hold("m", 1);
  jacobs.start[kExponent] = 1;
  // One of the two is the fit itself, unless a robust loss bent it.
  const bool known = prepared.problem.loss == Loss::none;
  const auto bent =
      known && prepared.model == FitModel::kinetic && prepared.problem.unknowns.size() == 3
          ? std::optional(solution)
          : solve(kinetic.problem, kinetic.start_inner());
  const auto straight =
      known && prepared.model == FitModel::jacobs && prepared.problem.unknowns.size() == 2
          ? std::optional(solution)
          : solve(jacobs.problem, jacobs.start_inner());
  if (!bent || !straight) return std::nullopt;
  const Diagnosis seen = diagnose(kinetic.problem, *bent, true);
  if (seen.singular || seen.freedom < 1) return std::nullopt;

  Reciprocity r;
  // Below this the sums of squares are rounding.
  const double least = n * std::pow(1e-9 * greatest, 2);
  const double squares_kinetic = std::max(2 * bent->cost, least);
  const double squares_jacobs = std::max(2 * straight->cost, squares_kinetic);
  r.f = (squares_jacobs - squares_kinetic) / (squares_kinetic / seen.freedom);
  r.p_value = f_exceedance(r.f, 1, seen.freedom);
  r.aic_jacobs = aicc(squares_jacobs, n, 2);
  r.aic_kinetic = aicc(squares_kinetic, n, 3);
  r.m = seen.law[kExponent];
  const double half = student_t_quantile(0.975, seen.freedom) * seen.stderr_inner(1);
  r.m_ci95 = {r.m - half, r.m + half};
  r.holds = r.p_value >= 0.05;
  const double worst_um =
      greatest_difference(kinetic.problem, jacobs.problem.law(straight->inner), seen.law);
  r.verdict = verdict_of(r, half, seen.stderr_inner(1), worst_um);
  return r;
}

std::vector<std::vector<double>> bootstrap(const PreparedFit& prepared, const Solution& solution,
                                           const Diagnosis& d, int count, std::uint64_t seed,
                                           const ExecutionContext& context) {
  const auto& all = prepared.problem.observations;
  std::array<std::vector<double>, 2> pool;
  std::vector<double> fitted(all.size());
  for (std::size_t i = 0; i < all.size(); ++i) {
    const auto k = static_cast<Eigen::Index>(i);
    fitted[i] = all[i].measured_um - d.residual(k) / all[i].weight;
    const double rest = 1 - d.leverage(k);
    if (rest > 1e-9) pool[all[i].is_dead_zone].push_back(d.residual(k) / std::sqrt(rest));
  }
  for (auto& residuals : pool) {
    const double n = static_cast<double>(residuals.size());
    const double mean = std::accumulate(residuals.begin(), residuals.end(), 0.0) / std::max(1.0, n);
    for (double& r : residuals) r -= mean;
    if (residuals.empty()) residuals.push_back(0);
  }
  std::vector<std::vector<double>> found(static_cast<std::size_t>(count));
  parallel_for(context, "bootstrap", found.size(), [&](std::size_t b) {
    Random random(seed * 0xD1342543DE82EF95ULL + b);
    Problem resampled = prepared.problem;
    for (std::size_t i = 0; i < all.size(); ++i) {
      const auto& residuals = pool[all[i].is_dead_zone];
      resampled.observations[i].measured_um =
          fitted[i] + residuals[random.below(residuals.size())] / all[i].weight;
    }
    // The optimum is near; resamplings need no more digits than their percentiles show.
    resampled.tolerance = std::max(resampled.tolerance, 1e-9);
    const auto refit = solve(resampled, solution.inner);
    if (!refit) return;
    for (std::size_t i = 0; i < refit->inner.size(); ++i) {
      found[b].push_back(resampled.unknowns[i].value(refit->inner[i]));
    }
  });
  std::erase_if(found, [](const auto& values) { return values.empty(); });
  return found;
}

}  // namespace slicecorr::resins
