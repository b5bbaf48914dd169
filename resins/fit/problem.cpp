#include "fit/problem.hpp"

#include <ceres/ceres.h>

#include <algorithm>
#include <cmath>
#include <memory>

#include "slicecorr/error.hpp"

namespace slicecorr::resins {

namespace {

/// All residuals of a problem as one block. A robust loss is taken inside, as residuals whose
/// squares are rho: one block stays cheap for a million points.
class Residuals : public ceres::CostFunction {
 public:
  explicit Residuals(const Problem& problem) : problem_(problem) {
    set_num_residuals(static_cast<int>(problem.observations.size()));
    mutable_parameter_block_sizes()->push_back(static_cast<int>(problem.unknowns.size()));
  }

  bool Evaluate(const double* const* inner, double* residual, double** jacobians) const override {
    double* const jacobian = jacobians ? jacobians[0] : nullptr;
    if (!problem_.residuals(inner[0], residual, jacobian)) return false;
    if (problem_.loss == Loss::none) return true;
    const std::size_t width = problem_.unknowns.size();
    for (std::size_t i = 0; i < problem_.observations.size(); ++i) {
      const double r = residual[i];
      const auto [value, slope, curvature] = rho(problem_.loss, problem_.loss_scale, r * r);
      const double root = std::sqrt(value);
      residual[i] = std::copysign(root, r);
      if (!jacobian) continue;
      // rho(r²) tends to r² for small r.
      const double factor = root > 0 ? std::abs(r) * slope / root : 1;
      for (std::size_t k = 0; k < width; ++k) jacobian[i * width + k] *= factor;
    }
    return true;
  }

 private:
  const Problem& problem_;
};

/// A number from 0 to 1 of the Halton sequence.
double halton(int index, int base) {
  double value = 0, step = 1;
  for (int i = index; i > 0; i /= base) {
    step /= base;
    value += step * (i % base);
  }
  return value;
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
    for (const Slot s : unknowns[i].slots) law[s] = unknowns[i].value(inner[i]);
  }
  for (std::size_t i = 0; i < observations.size(); ++i) {
    const Observation& o = observations[i];
    if (o.is_dead_zone && !(law[kUvHeight] < law[kHeight])) return false;
    const Height z = predict(law, o);
    residual[i] = o.weight * (o.measured_um - z.um);
    if (!std::isfinite(residual[i])) return false;
    if (!jacobian) continue;
    for (std::size_t k = 0; k < width; ++k) {
      double by = 0;
      for (const Slot s : unknowns[k].slots) by += z.by[s];
      by *= -o.weight * unknowns[k].stretch(law[unknowns[k].slots.front()]);
      if (!std::isfinite(by)) return false;
      jacobian[i * width + k] = by;
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
  Solution solution;
  if (width == 0) {
    std::vector<double> residual(problem.observations.size());
    if (!problem.residuals(start.data(), residual.data(), nullptr)) return std::nullopt;
    for (const double r : residual) {
      solution.cost += 0.5 * rho(problem.loss, problem.loss_scale, r * r)[0];
    }
    return solution;
  }
  ceres::Problem::Options ownership;
  ownership.cost_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  ceres::Problem ceres_problem(ownership);
  Residuals residuals(problem);
  ceres_problem.AddResidualBlock(&residuals, nullptr, start.data());
  for (std::size_t i = 0; i < width; ++i) {
    const Unknown& u = problem.unknowns[i];
    const double low = u.inner(u.low), high = u.inner(u.high);
    start[i] = std::clamp(start[i], low, high);
    const int index = static_cast<int>(i);
    ceres_problem.SetParameterLowerBound(start.data(), index, low);
    ceres_problem.SetParameterUpperBound(start.data(), index, high);
  }
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::DENSE_QR;
  options.logging_type = ceres::SILENT;
  options.num_threads = 1;
  options.max_num_iterations = 500;
  // Steps that leave the law's domain are refused; the trust region must get time to shrink.
  options.max_num_consecutive_invalid_steps = 60;
  options.function_tolerance = problem.tolerance;
  options.parameter_tolerance = problem.tolerance;
  options.gradient_tolerance = problem.tolerance;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &ceres_problem, &summary);
  if (!summary.IsSolutionUsable() || !std::isfinite(summary.final_cost)) return std::nullopt;
  solution.inner = std::move(start);
  solution.cost = summary.final_cost;
  solution.iterations = static_cast<int>(summary.iterations.size());
  return solution;
}

Solution solve_best(const Problem& problem, const std::vector<double>& first, int starts) {
  constexpr std::array<int, 6> bases = {2, 3, 5, 7, 11, 13};
  // Scale parameters are tried from a third to three times their first value.
  constexpr double scale_span = 1.0986, exponent_span = 0.4;
  std::optional<Solution> best;
  int iterations = 0;
  for (int k = 0; k < std::max(1, starts); ++k) {
    std::vector<double> start = first;
    for (std::size_t i = 0; k > 0 && i < start.size(); ++i) {
      const double span = problem.unknowns[i].is_scale ? scale_span : exponent_span;
      start[i] += span * (2 * halton(k, bases[i]) - 1);
    }
    const auto found = solve(problem, std::move(start));
    if (!found) continue;
    iterations += found->iterations;
    // A later start must be better by more than rounding, so that the choice is stable.
    if (!best || found->cost < best->cost * (1 - 1e-9)) best = found;
  }
  if (!best) {
    throw InputError(
        "no start of the fit led anywhere; expected measurements that the model can describe, "
        "or --bound and --fix nearer to them");
  }
  best->iterations = iterations;
  return *best;
}

}  // namespace slicecorr::resins
