// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "fit/least_squares.hpp"

#include <ceres/ceres.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "fit/statistics.hpp"

namespace slicecorr::resins {

namespace {

class SquaredResiduals : public ceres::CostFunction {
 public:
  explicit SquaredResiduals(const LeastSquares& problem) : problem_(problem) {
    set_num_residuals(static_cast<int>(problem.count()));
    mutable_parameter_block_sizes()->push_back(static_cast<int>(problem.unknowns()));
  }
  bool Evaluate(const double* const* values, double* residual, double** jacobians) const override {
    // Ceres complains to stderr where derivatives fail and residuals did not, or where a number is none,
    // so all are checked at once.
    if (at_.empty() || !std::equal(at_.begin(), at_.end(), values[0])) {
      at_.assign(values[0], values[0] + problem_.unknowns());
      residual_.resize(problem_.count());
      holds_ = problem_.residuals(at_.data(), residual_.data()) &&
               problem_.jacobian(at_.data(), j_) && j_.allFinite() &&
               std::all_of(residual_.begin(), residual_.end(),
                           [](double r) { return std::isfinite(r); });
    }
    if (!holds_) return false;
    std::copy(residual_.begin(), residual_.end(), residual);
    if (!jacobians || !jacobians[0]) return true;
    Eigen::Map<Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>>(
        jacobians[0], j_.rows(), j_.cols()) = j_;
    return true;
  }

 private:
  const LeastSquares& problem_;
  mutable std::vector<double> at_, residual_;
  mutable Eigen::MatrixXd j_;
  mutable bool holds_ = false;
};

}  // namespace

bool LeastSquares::jacobian(const double* values, Eigen::MatrixXd& out) const {
  const auto n = static_cast<Eigen::Index>(count());
  const auto p = static_cast<Eigen::Index>(unknowns());
  out.resize(n, p);
  Eigen::VectorXd low(n), high(n);
  std::vector<double> moved(values, values + p);
  for (Eigen::Index k = 0; k < p; ++k) {
    const auto i = static_cast<std::size_t>(k);
    const double value = moved[i], by = step(i, value);
    moved[i] = value - by;
    if (!residuals(moved.data(), low.data())) return false;
    moved[i] = value + by;
    if (!residuals(moved.data(), high.data())) return false;
    moved[i] = value;
    out.col(k) = (high - low) / (2 * by);
  }
  return true;
}

double LeastSquares::cost(const double* values) const {
  std::vector<double> r(count());
  if (!residuals(values, r.data())) return std::numeric_limits<double>::infinity();
  double sum = 0;
  for (const double v : r) sum += v * v;
  return sum;
}

double minimise(const LeastSquares& problem, std::vector<double>& values, double tolerance,
                int steps) {
  Eigen::MatrixXd j;
  if (!std::isfinite(problem.cost(values.data())) || !problem.jacobian(values.data(), j)) {
    return std::numeric_limits<double>::infinity();
  }
  SquaredResiduals residuals(problem);
  ceres::Problem::Options ownership;
  ownership.cost_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  ceres::Problem solved(ownership);
  solved.AddResidualBlock(&residuals, nullptr, values.data());
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::DENSE_QR;
  options.logging_type = ceres::SILENT;
  options.num_threads = 1;
  options.max_num_iterations = steps;
  options.max_num_consecutive_invalid_steps = 60;
  options.function_tolerance = options.parameter_tolerance = tolerance;
  options.gradient_tolerance = 1e-2 * tolerance;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &solved, &summary);
  if (!summary.IsSolutionUsable()) return std::numeric_limits<double>::infinity();
  return problem.cost(values.data());
}

FitShape shape_of(const LeastSquares& problem, const std::vector<double>& values) {
  FitShape shape;
  Eigen::MatrixXd j;
  shape.residual.resize(static_cast<Eigen::Index>(problem.count()));
  shape.holds =
      problem.residuals(values.data(), shape.residual.data()) && problem.jacobian(values.data(), j);
  if (!shape.holds) return shape;
  Eigen::VectorXd length = j.colwise().norm().transpose();
  for (auto& l : length) l = l > 0 ? l : 1;
  const Eigen::MatrixXd scaled = j * length.cwiseInverse().asDiagonal();
  const Eigen::JacobiSVD<Eigen::MatrixXd> svd(scaled, Eigen::ComputeThinU | Eigen::ComputeThinV);
  const auto& singular = svd.singularValues();
  const auto p = singular.size();
  // Derivatives are good to some 1e-7; a combination so flat would have an interval ten thousand
  // times that of an unknown alone.
  constexpr double least = 1e-4;
  if (!(singular(p - 1) > least * singular(0))) {
    const Eigen::VectorXd share = svd.matrixV().col(p - 1).cwiseAbs();
    for (Eigen::Index k = 0; k < p; ++k) {
      const bool dead = j.col(k).norm() == 0;
      if (share(k) < 0.2 * share.maxCoeff() && !dead) continue;
      shape.open.push_back(static_cast<std::size_t>(k));
    }
    return shape;
  }
  const Eigen::MatrixXd half = svd.matrixV() * singular.cwiseInverse().asDiagonal();
  shape.unscaled = length.cwiseInverse().asDiagonal() * (half * half.transpose()) *
                   length.cwiseInverse().asDiagonal();
  shape.leverage = svd.matrixU().rowwise().squaredNorm();
  return shape;
}

std::optional<std::size_t> outlier_of(const FitShape& shape, std::size_t unknowns,
                                      double rounding) {
  const double n = static_cast<double>(shape.residual.size());
  const double freedom = n - static_cast<double>(unknowns) - 1;
  if (freedom < 1) return std::nullopt;
  const double squares = shape.residual.squaredNorm();
  double worst = 0;
  std::size_t which = 0;
  for (Eigen::Index i = 0; i < shape.residual.size(); ++i) {
    const double rest = std::max(1e-9, 1 - shape.leverage(i)), r = shape.residual(i);
    // Scatter without this one.
    const double others = (squares - r * r / rest) / freedom;
    const double t = std::abs(r) / std::sqrt(rest * std::max(others, 1e-300));
    if (t > worst) {
      worst = t;
      which = static_cast<std::size_t>(i);
    }
  }
  const double limit = student_t_quantile(1 - 0.005 / n, freedom);
  // What is left of rounding is none.
  const bool seen = std::abs(shape.residual(static_cast<Eigen::Index>(which))) > rounding;
  return seen && worst > limit ? std::optional(which) : std::nullopt;
}

}  // namespace slicecorr::resins
