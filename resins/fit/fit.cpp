// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/resins/fit.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <limits>
#include <optional>

#include "fit/advice.hpp"
#include "fit/estimate.hpp"
#include "fit/statistics.hpp"
#include "slicecorr/error.hpp"

namespace slicecorr::resins {

namespace {

constexpr double kUnknownNumber = std::numeric_limits<double>::quiet_NaN();

bool is_exponent(const std::string& name) { return name == "m" || name == "m_uv"; }

/// An exponent that the measurements may not tell.
struct Doubt {
  std::string name;
  bool certain = false;  ///< no height depends on it alone
};

/// Close to the first gel the front's law bends so much that symmetric intervals miss the truth on one side. Other laws are
/// linear in disguise.
bool is_bent(const PreparedFit& s) {
  return s.problem.loss == Loss::none &&
         (s.model == FitModel::dead_zone_transient || s.model == FitModel::joint);
}

/// The 95 % interval of an active unknown reaches so far from its value on its wider side, in inner units.
double half_interval(const PreparedFit& s, const Solution& solution, const Diagnosis& d,
                     std::size_t active_index) {
  const double t = student_t_quantile(0.975, d.freedom);
  const double half = t * d.stderr_inner(active_index);
  if (!is_bent(s) || !(d.variance > 0)) return half;
  const Unknown& u = s.problem.unknowns[d.active[active_index]];
  const double best = solution.inner[d.active[active_index]];
  const auto [low, high] = profile_interval(s, solution, d, active_index, t);
  return std::max(half, std::max(best - u.inner(low), u.inner(high) - best));
}

/// Half an interval wider than 1 says nothing: theory has exponents from 1/2 to 1.
Doubt unknown_exponent(const PreparedFit& s, const Solution& solution, const FitOptions& options) {
  const Diagnosis d = diagnose(s.problem, solution, true);
  Doubt worst;
  double widest = 1;
  for (std::size_t k = 0; k < d.active.size(); ++k) {
    const std::string& name = s.problem.unknowns[d.active[k]].name;
    if (!is_exponent(name)) continue;
    if (d.singular) {
      if (d.null_direction(static_cast<Eigen::Index>(k)) > 1e-4) worst = {name, true};
      continue;
    }
    // A bound that was asked for is knowledge from elsewhere.
    if (d.freedom <= 0 || options.bounds.contains(name)) continue;
    const double half = half_interval(s, solution, d, k);
    if (half > widest) {
      widest = half;
      worst = {name, false};
    }
  }
  return worst;
}

/// F test of one parameter, at 5 %. Both problems are compared with the weights of the larger one.
bool clearly_worse(const PreparedFit& smaller, const Solution& less, const PreparedFit& larger,
                   const Solution& more) {
  const auto cost_at = [&](const PreparedFit& s, const Solution& at) {
    double cost = 0;
    const Slots law = s.problem.law(at.inner);
    for (const Observation& o : larger.problem.observations) {
      const double r = o.weight * (o.measured_um - s.problem.predict(law, o).um);
      cost += rho(larger.problem.loss, larger.problem.loss_scale, r * r)[0];
    }
    return cost;
  };
  const double freedom = static_cast<double>(larger.problem.observations.size()) -
                         static_cast<double>(larger.problem.unknowns.size());
  if (freedom <= 0) return false;
  const double free = cost_at(larger, more), held = cost_at(smaller, less);
  return f_exceedance((held - free) / (free / freedom), 1, freedom) < 0.05;
}

void fill_parameters(const PreparedFit& s, const Solution& solution, const Diagnosis& d,
                     FitResult& result) {
  const double t = d.freedom > 0 ? student_t_quantile(0.975, d.freedom) : kUnknownNumber;
  const bool bent = is_bent(s);
  for (const auto& kind : s.parameters) {
    Parameter p;
    p.name = kind.unknown.name;
    p.unit = kind.unit;
    p.value = d.law[kind.unknown.slots.front()];
    p.stderr_ = kUnknownNumber;
    p.ci95 = {kUnknownNumber, kUnknownNumber};
    p.fixed = true;
    for (std::size_t i = 0; i < s.problem.unknowns.size(); ++i) {
      if (s.problem.unknowns[i].name != p.name) continue;
      p.fixed = false;
      p.at_bound = d.at_bound[i];
    }
    for (std::size_t k = 0; k < d.active.size() && !d.singular && d.freedom > 0; ++k) {
      const Unknown& u = s.problem.unknowns[d.active[k]];
      if (u.name != p.name) continue;
      const double inner = d.stderr_inner(k);
      p.stderr_ = inner * u.stretch(p.value);
      p.ci95 = {u.value(u.inner(p.value) - t * inner), u.value(u.inner(p.value) + t * inner)};
      if (bent && d.variance > 0) p.ci95 = profile_interval(s, solution, d, k, t);
    }
    result.parameters.push_back(p);
  }
  // Of all free parameters; what stands at a bound has no variance that could be given.
  const std::size_t width = s.problem.unknowns.size();
  result.free_parameters = static_cast<int>(width);
  result.covariance.assign(width * width, kUnknownNumber);
  for (std::size_t i = 0; i < d.active.size() && !d.singular && d.freedom > 0; ++i) {
    for (std::size_t j = 0; j < d.active.size(); ++j) {
      const std::size_t a = d.active[i], b = d.active[j];
      const Unknown &u = s.problem.unknowns[a], &v = s.problem.unknowns[b];
      result.covariance[a * width + b] =
          d.variance * d.unscaled(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(j)) *
          u.stretch(d.law[u.slots.front()]) * v.stretch(d.law[v.slots.front()]);
    }
  }
}

/// A fit before an exponent was held because the measurements hardly tell it.
struct FreeFit {
  PreparedFit prepared;
  Solution solution;
};

/// Whether an exponent is held was decided by the same measurements: intervals that hold for its
/// value only promise too much. So they reach as far as any value of it that fits allows.
void widen_intervals(const FreeFit& free, FitResult& result) {
  if (free.prepared.problem.loss != Loss::none) return;
  const Diagnosis d = diagnose(free.prepared.problem, free.solution);
  if (d.singular || d.freedom <= 0 || !(d.variance > 0)) return;
  const double t = student_t_quantile(0.975, d.freedom);
  for (Parameter& p : result.parameters) {
    if (p.fixed || !std::isfinite(p.ci95[0])) continue;
    for (std::size_t k = 0; k < d.active.size(); ++k) {
      if (free.prepared.problem.unknowns[d.active[k]].name != p.name) continue;
      const auto wide = profile_interval(free.prepared, free.solution, d, k, t);
      p.ci95 = {std::min(p.ci95[0], wide[0]), std::max(p.ci95[1], wide[1])};
    }
  }
}

void fill_points(PreparedFit& s, const Diagnosis& d, FitResult& result) {
  result.points = std::move(s.points);
  for (std::size_t i = 0; i < s.problem.observations.size(); ++i) {
    result.points[s.point_of[i]].weight = s.problem.observations[i].weight;
  }
  for (FitPoint& p : result.points) {
    if (p.is_dead_zone) {
      p.predicted_um = predict_um(result, p.blue_mw_cm2, p.uv_mw_cm2, p.exposure_s);
    } else {
      // A dose alone: intensity 1 for as long as it takes, m is 1.
      const bool known = p.blue_mw_cm2 > 0;
      const Exposure e{known ? std::log(p.blue_mw_cm2) : 0, 0,
                       std::log(known ? p.exposure_s : p.dose_mj_cm2)};
      p.predicted_um = cured_height(d.law, e).um;
    }
  }
}

KindFit summary_of(const FitResult& result, bool dead_zones, bool all) {
  KindFit kind;
  double sum = 0, squares = 0, total = 0;
  const auto counts = [&](const FitPoint& p) {
    return p.weight > 0 && (all || p.is_dead_zone == dead_zones);
  };
  for (const FitPoint& p : result.points) {
    if (!counts(p)) continue;
    ++kind.n;
    sum += p.measured_um;
  }
  if (kind.n == 0) return kind;
  for (const FitPoint& p : result.points) {
    if (!counts(p)) continue;
    squares += std::pow(p.measured_um - p.predicted_um, 2);
    total += std::pow(p.measured_um - sum / kind.n, 2);
  }
  kind.squares = squares;
  kind.total = total;
  kind.r2 = total > 0 ? 1 - squares / total : kUnknownNumber;
  kind.rmse_um = std::sqrt(squares / kind.n);
  return kind;
}

void fill_quality(const PreparedFit& s, const Diagnosis& d, FitResult& result) {
  result.cured = summary_of(result, false, false);
  result.dead_zones = summary_of(result, true, false);
  const double squares = result.cured.squares + result.dead_zones.squares;
  // Each kind about its own mean: the difference between the kinds is no success of the fit.
  const double total = result.cured.total + result.dead_zones.total;
  result.n = result.cured.n + result.dead_zones.n;
  result.r2 = total > 0 ? 1 - squares / total : kUnknownNumber;
  result.rmse_um = std::sqrt(squares / result.n);
  result.sigma_um = d.freedom > 0 ? std::sqrt(squares / d.freedom) : kUnknownNumber;
  const KindScatter scatter = scatter_of_kinds(s.problem, d);
  result.cured.sigma_um = scatter.cured_um;
  result.dead_zones.sigma_um = scatter.dead_zone_um;
}

double percentile(const std::vector<double>& sorted, double share) {
  const double at = share * static_cast<double>(sorted.size() - 1);
  const auto below = static_cast<std::size_t>(at);
  const std::size_t above = std::min(below + 1, sorted.size() - 1);
  return sorted[below] + (at - std::floor(at)) * (sorted[above] - sorted[below]);
}

void fill_bootstrap(const PreparedFit& s, const Solution& solution, const Diagnosis& d,
                    const FitOptions& options, const ExecutionContext& context, FitResult& result) {
  if (options.bootstrap == 0 || d.freedom <= 0 || d.singular) return;
  const auto rows = bootstrap(s, solution, d, options.bootstrap, options.seed, context);
  const std::size_t lost = static_cast<std::size_t>(options.bootstrap) - rows.size();
  if (lost > 0) {
    result.warnings.push_back(
        fmt::format("{} of {} resampled fits failed and are not in the bootstrap intervals", lost,
                    options.bootstrap));
  }
  if (rows.size() < 20) {
    result.warnings.push_back(
        fmt::format("{} resampled fits are too few for bootstrap intervals; expected 20 or more, "
                    "better 1000",
                    rows.size()));
    return;
  }
  for (std::size_t i = 0; i < s.problem.unknowns.size(); ++i) {
    std::vector<double> values;
    values.reserve(rows.size());
    for (const auto& row : rows) values.push_back(row[i]);
    std::sort(values.begin(), values.end());
    for (Parameter& p : result.parameters) {
      if (p.name == s.problem.unknowns[i].name) {
        p.bootstrap95 = {percentile(values, 0.025), percentile(values, 0.975)};
      }
    }
  }
}

}  // namespace

FitResult fit(const Measurements& data, FitModel model, const FitOptions& options,
              const ExecutionContext& context) {
  const auto begin = std::chrono::steady_clock::now();
  PreparedFit prepared = prepare_fit(data, model, options);
  context.check_cancelled();
  Solution solution = estimate(prepared, options);

  std::vector<std::string> held;
  std::optional<FreeFit> free;  // the first that had an exponent more
  for (int round = 0; round < 2; ++round) {
    const auto [name, certain] = unknown_exponent(prepared, solution, options);
    if (name.empty()) break;
    const bool shared_m = model == FitModel::joint && !options.separate_m && name == "m";
    if (shared_m) break;
    PreparedFit without = prepared;
    const double value = model == FitModel::dead_zone_transient ? options.m : 1;
    without.start = prepared.problem.law(solution.inner);
    if (name == "m_uv") {
      without.share_exponent();
    } else {
      without.hold(name, value);
    }
    const Solution simpler = estimate(without, options);
    // A wide interval is no reason to hold what the measurements contradict.
    if (!certain && clearly_worse(without, simpler, prepared, solution)) break;
    held.push_back(
        name == "m_uv" ? fmt::format("m_uv can't be known apart from m, so one m serves both: {}",
                                     why_unknown(prepared, name))
        : certain
            ? fmt::format("{} can't be known, and was held at {:.4g}: {}. The other parameters and "
                          "their intervals hold for that {} only",
                          name, value, why_unknown(prepared, name), name)
            : fmt::format("{} can't be known, and was held at {:.4g}: {}. The other parameters "
                          "hold for that {} only; their intervals allow for any that fits",
                          name, value, why_unknown(prepared, name), name));
    if (!certain && !free) free = FreeFit{prepared, solution};
    prepared = std::move(without);
    solution = simpler;
  }
  const Diagnosis diagnosis = diagnose(prepared.problem, solution);
  if (diagnosis.singular) {
    Eigen::Index most = 0;
    diagnosis.null_direction.maxCoeff(&most);
    const std::string& name =
        prepared.problem.unknowns[diagnosis.active[static_cast<std::size_t>(most)]].name;
    throw InputError(
        fmt::format("the {} model can't be fitted: {} can't be known apart from the other "
                    "parameters; {}, or hold it with --fix",
                    name_of(model), name, why_unknown(prepared, name)));
  }
  context.check_cancelled();

  FitResult result;
  result.model = model;
  result.sources = data.sources;
  result.hb_um = diagnosis.law[kHeight];
  result.critical_dose_prime = diagnosis.law[kDose];
  result.m = diagnosis.law[kExponent];
  result.iterations = solution.iterations;
  result.warnings = data.warnings;
  result.warnings.insert(result.warnings.end(), prepared.warnings.begin(), prepared.warnings.end());
  result.warnings.insert(result.warnings.end(), held.begin(), held.end());
  fill_parameters(prepared, solution, diagnosis, result);
  for (Parameter& p : result.parameters) p.bound_given = options.bounds.contains(p.name);
  if (free) widen_intervals(*free, result);
  fill_points(prepared, diagnosis, result);
  fill_quality(prepared, diagnosis, result);
  find_outliers(prepared, diagnosis, result);
  const auto advice = advise(prepared, result, diagnosis);
  result.warnings.insert(result.warnings.end(), advice.begin(), advice.end());
  if (model == FitModel::jacobs || model == FitModel::kinetic) {
    if (options.fixed.empty() && options.bounds.empty()) {
      result.reciprocity = test_reciprocity(prepared, solution, diagnosis, result.points);
    }
  }
  fill_bootstrap(prepared, solution, diagnosis, options, context, result);
  result.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  return result;
}

}  // namespace slicecorr::resins
