// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "fit/problem.hpp"

#include <ceres/ceres.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>

#include "slicecorr/error.hpp"

namespace slicecorr::resins {

namespace {

// Squares and their sums must stay finite.
constexpr double kGreatestNumber = 1e100;

/// All residuals of a problem as one block. A robust loss is taken inside, as residuals whose
/// squares are rho: one block stays cheap for a million points.
class RobustResiduals : public ceres::CostFunction {
 public:
  explicit RobustResiduals(const Problem& problem) : problem_(problem) {
    set_num_residuals(static_cast<int>(problem.observations.size()));
    mutable_parameter_block_sizes()->push_back(static_cast<int>(problem.unknowns.size()));
  }

  bool Evaluate(const double* const* inner, double* residual, double** jacobians) const override {
    const std::size_t width = problem_.unknowns.size();
    if (at_.empty() || !std::equal(at_.begin(), at_.end(), inner[0])) {
      at_.assign(inner[0], inner[0] + width);
      holds_ = evaluate();
    }
    if (!holds_) return false;
    std::copy(residual_.begin(), residual_.end(), residual);
    if (jacobians && jacobians[0]) {
      std::copy(jacobian_.begin(), jacobian_.end(), jacobians[0]);
    }
    return true;
  }

 private:
  bool evaluate() const {
    const std::size_t width = problem_.unknowns.size();
    residual_.resize(problem_.observations.size());
    jacobian_.resize(residual_.size() * width);
    if (!problem_.residuals(at_.data(), residual_.data(), jacobian_.data())) return false;
    if (problem_.loss == Loss::none) return true;
    for (std::size_t i = 0; i < residual_.size(); ++i) {
      const double r = residual_[i];
      const auto [value, slope, curvature] = rho(problem_.loss, problem_.loss_scale, r * r);
      const double root = std::sqrt(value);
      residual_[i] = std::copysign(root, r);
      // rho(r²) tends to r² for small r.
      const double factor = root > 0 ? std::abs(r) * slope / root : 1;
      for (std::size_t k = 0; k < width; ++k) jacobian_[i * width + k] *= factor;
    }
    return true;
  }

  const Problem& problem_;
  // Ceres asks for residuals first, and for derivatives at the same place later; the law gives
  // both at once.
  mutable std::vector<double> at_, residual_, jacobian_;
  mutable bool holds_ = false;
};

/// Infinite where the law does not hold.
double cost_at(const Problem& problem, const std::vector<double>& inner) {
  std::vector<double> residual(problem.observations.size());
  if (!problem.residuals(inner.data(), residual.data(), nullptr)) {
    return std::numeric_limits<double>::infinity();
  }
  double cost = 0;
  for (const double r : residual) cost += 0.5 * rho(problem.loss, problem.loss_scale, r * r)[0];
  return cost;
}

/// From a start inside the bounds, if there are any.
std::optional<Solution> minimise(const Problem& problem, std::vector<double> inner,
                                 const double* low, const double* high) {
  if (!std::isfinite(cost_at(problem, inner))) return std::nullopt;
  ceres::Problem::Options ownership;
  ownership.cost_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  ceres::Problem ceres_problem(ownership);
  RobustResiduals residuals(problem);
  ceres_problem.AddResidualBlock(&residuals, nullptr, inner.data());
  for (std::size_t i = 0; low && i < inner.size(); ++i) {
    ceres_problem.SetParameterLowerBound(inner.data(), static_cast<int>(i), low[i]);
    ceres_problem.SetParameterUpperBound(inner.data(), static_cast<int>(i), high[i]);
  }
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::DENSE_QR;
  options.logging_type = ceres::SILENT;
  options.num_threads = 1;
  options.max_num_iterations = 200;
  // Steps that leave the law's domain are refused; the trust region must get time to shrink.
  options.max_num_consecutive_invalid_steps = 60;
  options.function_tolerance = problem.tolerance;
  options.parameter_tolerance = problem.tolerance;
  options.gradient_tolerance = problem.tolerance;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &ceres_problem, &summary);
  if (!summary.IsSolutionUsable() || !std::isfinite(summary.final_cost)) return std::nullopt;
  return Solution{std::move(inner), summary.final_cost,
                  static_cast<int>(summary.iterations.size())};
}

/// Ceres cuts steps off at bounds, and stops early where parameters go together. Which bounds hold
/// it tells well enough to solve the rest freely; each is then checked by the slope of the cost.
Solution settle_at_bounds(const Problem& problem, const Solution& begin,
                          const std::vector<double>& low, const std::vector<double>& high) {
  const std::size_t width = problem.unknowns.size();
  Solution best = begin, now = begin;
  std::vector<bool> held(width);
  for (std::size_t i = 0; i < width; ++i) {
    const double near = 1e-9 * (high[i] - low[i]);
    held[i] = now.inner[i] <= low[i] + near || now.inner[i] >= high[i] - near;
  }
  for (std::size_t round = 0; round < 4 * width; ++round) {
    Problem rest = problem;
    rest.unknowns.clear();
    std::vector<double> inner;
    for (std::size_t i = 0; i < width; ++i) {
      const Unknown& u = problem.unknowns[i];
      if (held[i]) {
        // To the nearer one, exactly.
        const bool at_low = now.inner[i] - low[i] < high[i] - now.inner[i];
        now.inner[i] = at_low ? low[i] : high[i];
        for (const Slot s : u.slots) rest.fixed[s] = u.value(now.inner[i]);
      } else {
        rest.unknowns.push_back(u);
        inner.push_back(now.inner[i]);
      }
    }
    std::optional<Solution> found;
    if (inner.empty()) {
      found = Solution{{}, cost_at(rest, inner), 0};
    } else {
      found = minimise(rest, inner, nullptr, nullptr);
    }
    if (!found || !std::isfinite(found->cost)) break;
    best.iterations += found->iterations;
    bool inside = true;
    for (std::size_t i = 0, k = 0; i < width; ++i) {
      if (held[i]) continue;
      const double value = found->inner[k++];
      now.inner[i] = std::clamp(value, low[i], high[i]);
      if (value >= low[i] && value <= high[i]) continue;
      held[i] = true;
      inside = false;
    }
    if (!inside) continue;
    if (found->cost <= best.cost) {
      best.inner = now.inner;
      best.cost = found->cost;
    }
    // Does the cost fall from a bound inwards?
    std::vector<double> residual(problem.observations.size());
    std::vector<double> jacobian(problem.observations.size() * width);
    if (!problem.residuals(now.inner.data(), residual.data(), jacobian.data())) break;
    bool released = false;
    for (std::size_t i = 0; i < width && !released; ++i) {
      if (!held[i]) continue;
      double slope = 0, scale = 0;
      for (std::size_t k = 0; k < residual.size(); ++k) {
        const double r = residual[k];
        const double part =
            rho(problem.loss, problem.loss_scale, r * r)[1] * r * jacobian[k * width + i];
        slope += part;
        scale += std::abs(part);
      }
      const double inwards = now.inner[i] == low[i] ? -slope : slope;
      released = inwards > 1e-9 * scale;
      if (released) held[i] = false;
    }
    if (!released) break;
  }
  return best;
}

}  // namespace

double Unknown::inner(double value) const { return is_scale ? std::log(value) : value; }
double Unknown::value(double inner) const { return is_scale ? std::exp(inner) : inner; }

Slots Problem::law(const std::vector<double>& inner) const {
  Slots law = fixed;
  for (std::size_t i = 0; i < unknowns.size(); ++i) {
    for (const Slot s : unknowns[i].slots) law[s] = unknowns[i].value(inner[i]);
  }
  return law;
}

Height Problem::predict(const Slots& law, const Observation& o) const {
  if (!o.is_dead_zone) return cured_height(law, o.exposure);
  return is_steady ? steady_height(law, o.exposure) : front_height(law, o.exposure);
}

bool Problem::residuals(const double* inner, double* residual, double* jacobian) const {
  const std::size_t width = unknowns.size();
  Slots law = fixed;
  for (std::size_t i = 0; i < width; ++i) {
    const double value = unknowns[i].value(inner[i]);
    if (!(value > 0)) return false;
    for (const Slot s : unknowns[i].slots) law[s] = value;
  }
  for (std::size_t i = 0; i < observations.size(); ++i) {
    const Observation& o = observations[i];
    if (o.is_dead_zone && !(law[kUvHeight] < law[kHeight])) return false;
    const Height z = predict(law, o);
    residual[i] = o.weight * (o.measured_um - z.um);
    if (!(std::abs(residual[i]) < kGreatestNumber)) return false;
    // Derivatives are checked even when nobody asks: Ceres stops with a message on stderr when they
    // fail at a point where the residuals did not.
    for (std::size_t k = 0; k < width; ++k) {
      double by = 0;
      for (const Slot slot : unknowns[k].slots) by += z.by[slot];
      by *= -o.weight * unknowns[k].stretch(law[unknowns[k].slots.front()]);
      if (!(std::abs(by) < kGreatestNumber)) return false;
      if (jacobian) jacobian[i * width + k] = by;
    }
  }
  return true;
}

std::array<double, 3> rho(Loss loss, double scale, double squared) {
  std::array<double, 3> values = {squared, 1, 0};
  if (loss == Loss::soft_l1) ceres::SoftLOneLoss(scale).Evaluate(squared, values.data());
  if (loss == Loss::cauchy) ceres::CauchyLoss(scale).Evaluate(squared, values.data());
  return values;
}

std::optional<Solution> solve(const Problem& problem, std::vector<double> start) {
  const std::size_t width = problem.unknowns.size();
  if (width == 0) {
    const double cost = cost_at(problem, start);
    if (!std::isfinite(cost)) return std::nullopt;
    return Solution{start, cost, 0};
  }
  std::vector<double> low, high;
  for (std::size_t i = 0; i < width; ++i) {
    const Unknown& u = problem.unknowns[i];
    low.push_back(u.inner(u.low));
    high.push_back(u.inner(u.high));
    start[i] = std::clamp(start[i], low[i], high[i]);
  }
  // Ceres searches along a line in each step of a bounded problem, which takes several times as
  // long: bounds come in only when the free solution lies outside.
  auto found = minimise(problem, start, nullptr, nullptr);
  const auto inside = [&](const std::vector<double>& inner) {
    for (std::size_t i = 0; i < width; ++i) {
      if (!(inner[i] >= low[i] && inner[i] <= high[i])) return false;
    }
    return true;
  };
  if (found && inside(found->inner)) return found;
  found = minimise(problem, start, low.data(), high.data());
  return found ? settle_at_bounds(problem, *found, low, high) : found;
}

Solution solve_best(const Problem& problem, const std::vector<std::vector<double>>& starts) {
  // Which start leads lowest shows with a few digits; the best one gets all.
  Problem rough = problem;
  if (starts.size() > 1) rough.tolerance = std::max(problem.tolerance, 1e-6);
  // Far off, the front's law leads into corners where nothing gels, slowly and for nothing.
  constexpr double hopeless = 30;
  std::vector<double> costs;
  costs.reserve(starts.size());
  for (const auto& start : starts) costs.push_back(cost_at(problem, start));
  const double lowest = *std::min_element(costs.begin(), costs.end());
  std::optional<Solution> best;
  int iterations = 0;
  for (std::size_t i = 0; i < starts.size(); ++i) {
    if (costs[i] > hopeless * lowest) continue;
    auto found = solve(rough, starts[i]);
    if (!found) continue;
    iterations += found->iterations;
    // A later start must be clearly better, so that the choice is stable.
    if (!best || found->cost < best->cost * (1 - 1e-4)) best = std::move(found);
  }
  if (best && starts.size() > 1) {
    if (auto polished = solve(problem, best->inner)) {
      iterations += polished->iterations;
      if (polished->cost <= best->cost) best = std::move(polished);
    }
  }
  if (!best) {
    throw InputError(
        "no start of the fit led anywhere; expected measurements that the model can describe, or "
        "--bound and --fix nearer to them");
  }
  best->iterations = iterations;
  return *best;
}

}  // namespace slicecorr::resins
