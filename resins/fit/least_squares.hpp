// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file least_squares.hpp
/// Least squares of few unknowns, with derivatives by differences: found by Ceres, judged by the
/// shape of the sum of squares where it is least.
///
/// For one thread at a time.
#pragma once

#include <Eigen/Dense>
#include <optional>
#include <vector>

namespace slicecorr::resins {

class LeastSquares {
 public:
  virtual ~LeastSquares() = default;
  virtual std::size_t count() const = 0;  ///< of residuals
  virtual std::size_t unknowns() const = 0;
  /// By which an unknown of this value is moved for its derivatives, > 0.
  virtual double step(std::size_t unknown, double value) const = 0;
  /// False where nothing is as these unknowns say.
  virtual bool residuals(const double* values, double* out) const = 0;

  /// By central differences, unless the problem knows better; false where a residual is missing.
  virtual bool jacobian(const double* values, Eigen::MatrixXd& out) const;
  /// Sum of squares; infinite where residuals are missing.
  double cost(const double* values) const;
};

/// Relative, of the sum of squares and of unknowns: as fine as it gets.
inline constexpr double kFine = 1e-12;

/// From `values` downhill to the least sum of squares, which it returns; infinite where nothing was
/// found.
double minimise(const LeastSquares& problem, std::vector<double>& values, double tolerance,
                int steps);

/// What the derivatives at the best place say.
struct FitShape {
  bool holds = false;  ///< false: a residual or derivative is missing there, and all else is, too
  Eigen::VectorXd residual, leverage;
  Eigen::MatrixXd unscaled;  ///< inverse of J'J; empty when something is open
  /// Unknowns in a combination that changes no residual; none: all can be told.
  std::vector<std::size_t> open;
};
FitShape shape_of(const LeastSquares& problem, const std::vector<double>& values);

/// The residual that can least belong to the others, if it can't at all (p < 0.01 for the worst of
/// all). What is within `rounding` of 0 belongs.
std::optional<std::size_t> outlier_of(const FitShape& shape, std::size_t unknowns,
                                      double rounding = 1e-6);

}  // namespace slicecorr::resins
