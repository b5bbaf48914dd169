// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file diagnosis.hpp
/// What the Jacobian at the optimum says: covariance, leverage, scatter, what can't be known.
#pragma once

#include <Eigen/Dense>
#include <string>
#include <vector>

#include "fit/prepare.hpp"

namespace slicecorr::resins {

struct Diagnosis {
  Slots law{};
  std::vector<bool> at_bound;  ///< by unknown
  /// Unknowns that count: not at a bound.
  std::vector<std::size_t> active;
  /// Weighted residuals, and derivatives of the weighted heights by active inner values.
  Eigen::VectorXd residual;
  Eigen::MatrixXd jacobian;
  /// Of the active inner values, without the scatter: inverse of J'J. Empty when `singular`.
  Eigen::MatrixXd unscaled;
  Eigen::VectorXd leverage;  ///< by observation; zeros when `singular`
  int freedom = 0;           ///< n - p
  /// Variance of a weighted residual of weight 1; with a robust loss after Huber (below).
  double variance = 0;
  /// The same seen by one residual at a time; equals `variance` without a robust loss.
  double robust_variance = 0;
  /// Some combination of the active unknowns does not change any height.
  bool singular = false;
  /// Share of each active unknown in that combination.
  Eigen::VectorXd null_direction;

  double stderr_inner(std::size_t active_index) const {
    return std::sqrt(variance * unscaled(static_cast<Eigen::Index>(active_index),
                                         static_cast<Eigen::Index>(active_index)));
  }
};

/// With a robust loss the covariance is Huber's: variance = K² sum(psi²) / (n - p) / mean(psi')²,
/// K = 1 + p var(psi') / (n mean(psi')²) (Huber, Robust Statistics, 1981, 7.6), times inverse J'J.
/// `count_bounded`: unknowns at a bound are active, too.
Diagnosis diagnose(const Problem& problem, const Solution& solution, bool count_bounded = false);

/// Median of the absolute values over that of a normal distribution: scatter that outliers leave.
double robust_sigma(std::vector<double> residuals, std::size_t parameters);

}  // namespace slicecorr::resins
