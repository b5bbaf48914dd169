// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "fit/diagnosis.hpp"

#include <algorithm>
#include <cmath>

#include "slicecorr/error.hpp"

namespace slicecorr::resins {

namespace {

using Rows = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

// Columns are scaled to length 1 first. Rounding in the Jacobian is some 1e-14; a combination this
// flat would have an interval a million times that of a single parameter.
constexpr double kLeastSingularRatio = 1e-7;

}  // namespace

double robust_sigma(std::vector<double> residuals, std::size_t parameters) {
  const std::size_t n = residuals.size();
  if (n == 0) return 0;
  for (double& r : residuals) r = std::abs(r);
  const auto middle = residuals.begin() + static_cast<std::ptrdiff_t>(n / 2);
  std::nth_element(residuals.begin(), middle, residuals.end());
  double median = *middle;
  if (n % 2 == 0) median = 0.5 * (median + *std::max_element(residuals.begin(), middle));
  const double freedom =
      std::max<double>(1, static_cast<double>(n) - static_cast<double>(parameters));
  return median / 0.6744897501960817 * std::sqrt(static_cast<double>(n) / freedom);
}

Diagnosis diagnose(const Problem& problem, const Solution& solution, bool count_bounded) {
  const auto n = static_cast<Eigen::Index>(problem.observations.size());
  const auto width = static_cast<Eigen::Index>(problem.unknowns.size());
  Diagnosis d;
  d.law = problem.law(solution.inner);
  Rows jacobian(n, width);
  d.residual.resize(n);
  if (!problem.residuals(solution.inner.data(), d.residual.data(), jacobian.data())) {
    throw InputError(
        "the fit ended where the model does not hold; expected other --bound or --fix");
  }
  for (std::size_t i = 0; i < problem.unknowns.size(); ++i) {
    const Unknown& u = problem.unknowns[i];
    const double low = u.inner(u.low), high = u.inner(u.high), near = 1e-9 * (high - low);
    d.at_bound.push_back(solution.inner[i] < low + near || solution.inner[i] > high - near);
    if (count_bounded || !d.at_bound.back()) d.active.push_back(i);
  }
  const auto p = static_cast<Eigen::Index>(d.active.size());
  d.jacobian.resize(n, p);
  for (Eigen::Index k = 0; k < p; ++k) {
    // Residuals fall where heights rise.
    d.jacobian.col(k) =
        -jacobian.col(static_cast<Eigen::Index>(d.active[static_cast<std::size_t>(k)]));
  }
  d.leverage = Eigen::VectorXd::Zero(n);
  d.freedom = static_cast<int>(n - p);

  if (p > 0) {
    Eigen::VectorXd length = d.jacobian.colwise().norm().transpose();
    for (auto& l : length) l = l > 0 ? l : 1;
    const Eigen::MatrixXd scaled = d.jacobian * length.cwiseInverse().asDiagonal();
    const Eigen::HouseholderQR<Eigen::MatrixXd> qr(scaled);
    const Eigen::MatrixXd r = qr.matrixQR().topRows(std::min(n, p)).triangularView<Eigen::Upper>();
    const Eigen::JacobiSVD<Eigen::MatrixXd> svd(r, Eigen::ComputeFullU | Eigen::ComputeFullV);
    const auto& values = svd.singularValues();
    d.singular = n < p || !(values(values.size() - 1) > kLeastSingularRatio * values(0));
    d.null_direction = svd.matrixV().col(p - 1).cwiseAbs();
    if (!d.singular) {
      // J = Q R, so inverse J'J = R^-1 R^-T, and the hat matrix is Q Q'.
      const Eigen::MatrixXd inverse =
          r.triangularView<Eigen::Upper>().solve(Eigen::MatrixXd::Identity(p, p));
      d.leverage = (scaled * inverse).rowwise().squaredNorm();
      d.unscaled = length.cwiseInverse().asDiagonal() * (inverse * inverse.transpose()) *
                   length.cwiseInverse().asDiagonal();
    }
  }
  if (d.freedom <= 0) return d;

  const double freedom = d.freedom;
  const double count = static_cast<double>(n);
  if (problem.loss == Loss::none) {
    d.variance = d.robust_variance = d.residual.squaredNorm() / freedom;
    return d;
  }
  double squares = 0, slope = 0, slope_squared = 0;
  for (const double r : d.residual) {
    const auto [value, first, second] = rho(problem.loss, problem.loss_scale, r * r);
    const double psi = first * r, psi_slope = first + 2 * second * r * r;
    squares += psi * psi;
    slope += psi_slope / count;
    slope_squared += psi_slope * psi_slope / count;
  }
  slope = std::max(slope, 1e-3);
  const double spread = std::max(0.0, slope_squared - slope * slope);
  const double k = 1 + static_cast<double>(p) / count * spread / (slope * slope);
  d.variance = k * k * squares / freedom / (slope * slope);
  const double sigma = robust_sigma({d.residual.begin(), d.residual.end()}, d.active.size());
  d.robust_variance = sigma * sigma;
  return d;
}

}  // namespace slicecorr::resins
