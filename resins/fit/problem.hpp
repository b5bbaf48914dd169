// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file problem.hpp
/// A least-squares problem of heights, and its solution with Ceres.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "fit/heights.hpp"
#include "slicecorr/resins/fit.hpp"

namespace slicecorr::resins {

/// A measured height with the weight of its residual.
struct Observation {
  bool is_dead_zone = false;
  Exposure exposure;
  double measured_um = 0;
  double weight = 1;
};

/// A free parameter. Scale parameters (all but exponents) are solved for by their logarithm.
struct Unknown {
  std::string name;
  std::vector<Slot> slots;  ///< one, or two that are kept equal
  bool is_scale = true;
  double low = 0, high = 0;  ///< bounds of the value

  double inner(double value) const;
  double value(double inner) const;
  /// d value / d inner.
  double stretch(double value) const { return is_scale ? value : 1; }
};

/// Weighted residuals: weight times (measured minus predicted); minimised is the sum of
/// rho(residual²) with rho of scale `loss_scale`.
struct Problem {
  std::vector<Observation> observations;
  bool is_steady = false;  ///< dead zones by the steady law
  Slots fixed{};           ///< values of what is not free
  std::vector<Unknown> unknowns;
  Loss loss = Loss::none;
  double loss_scale = 0;  ///< of weighted residuals
  double tolerance = 1e-12;

  Slots law(const std::vector<double>& inner) const;
  Height predict(const Slots& law, const Observation& o) const;
  /// Residuals, and derivatives by inner values row by row when `jacobian` is not null. False when
  /// the law does not hold there (huv >= h) or a number overflows.
  bool residuals(const double* inner, double* residual, double* jacobian) const;
};

/// rho, rho' and rho'' of a squared residual.
std::array<double, 3> rho(Loss loss, double scale, double squared);

struct Solution {
  std::vector<double> inner;
  double cost = 0;
  int iterations = 0;
};
/// From one start, which is moved inside the bounds; nothing when the law does not hold there.
std::optional<Solution> solve(const Problem& problem, std::vector<double> start);
/// The best result of several starts; throws `InputError` when none leads anywhere.
Solution solve_best(const Problem& problem, const std::vector<std::vector<double>>& starts);

}  // namespace slicecorr::resins
