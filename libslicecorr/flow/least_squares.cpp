// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "flow/least_squares.hpp"

#include <Eigen/Cholesky>
#include <algorithm>

namespace slicecorr::disc {

namespace {

/// The longest step, up to 1, that leaves all of v above 0.
double longest(const Eigen::VectorXd& v, const Eigen::VectorXd& dv) {
  double step = 1;
  for (Eigen::Index i = 0; i < v.size(); ++i) {
    if (dv[i] < 0) step = std::min(step, -v[i] / dv[i]);
  }
  return step;
}

}  // namespace

Eigen::VectorXd bounded_least_squares(const Eigen::MatrixXd& M, const Eigen::VectorXd& y,
                                      const Eigen::MatrixXd& A, const Eigen::VectorXd& b) {
  using Eigen::VectorXd;
  Eigen::MatrixXd H = M.transpose() * M;
  H.diagonal().array() += 1e-12 * std::max(H.diagonal().maxCoeff(), 1e-300);
  const VectorXd g = M.transpose() * y;
  const double rows = static_cast<double>(b.size());
  VectorXd x = VectorXd::Zero(g.size());
  VectorXd slack = b.cwiseMax(1), price = VectorXd::Ones(b.size());
  const double tolerance_g = 1e-9 * (1 + g.cwiseAbs().maxCoeff());
  const double tolerance_b = 1e-9 * (1 + b.cwiseAbs().maxCoeff());
  for (int round = 0; round < 100; ++round) {
    const VectorXd stationary = H * x - g + A.transpose() * price;
    const VectorXd apart = A * x + slack - b;
    const double mean = slack.dot(price) / rows;
    if (stationary.cwiseAbs().maxCoeff() <= tolerance_g &&
        apart.cwiseAbs().maxCoeff() <= tolerance_b && mean <= 1e-12) {
      break;
    }
    const VectorXd weight = price.cwiseQuotient(slack);
    const Eigen::LDLT<Eigen::MatrixXd> factors(H + A.transpose() * weight.asDiagonal() * A);
    VectorXd dx, dslack, dprice;
    const auto solve = [&](const VectorXd& product) {
      dx = factors.solve(
          -stationary - A.transpose() * (price.cwiseProduct(apart) - product).cwiseQuotient(slack));
      dslack = -apart - A * dx;
      dprice = -(product + price.cwiseProduct(dslack)).cwiseQuotient(slack);
    };
    // Straight for the bounds first; how far that gets says how much to keep away from them.
    solve(slack.cwiseProduct(price));
    const double step_slack = longest(slack, dslack), step_price = longest(price, dprice);
    const double ahead = (slack + step_slack * dslack).dot(price + step_price * dprice) / rows;
    const double part = ahead / mean, keep = part * part * part * mean;
    solve((slack.cwiseProduct(price) + dslack.cwiseProduct(dprice)).array() - keep);
    const double step = 0.995 * std::min(longest(slack, dslack), longest(price, dprice));
    x += step * dx;
    slack += step * dslack;
    price += step * dprice;
  }
  return x;
}

}  // namespace slicecorr::disc
