// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file prepare.hpp
/// From measurements and options to a problem: what is observed, what is unknown, where to start.
#pragma once

#include <span>
#include <string>
#include <vector>

#include "fit/problem.hpp"

namespace slicecorr::resins {

/// A parameter of a model: its name in the contract and what it is in the law.
struct ParameterKind {
  Unknown unknown;  ///< name, slots and bounds
  std::string unit;
};
/// In the order in which they are reported.
std::vector<ParameterKind> parameters_of(FitModel model, const FitOptions& options);

/// A fit that is ready to be solved.
struct PreparedFit {
  FitModel model = FitModel::jacobs;
  std::vector<ParameterKind> parameters;
  Problem problem;
  std::vector<FitPoint> points;       ///< all, those with weight 0 included
  std::vector<std::size_t> point_of;  ///< of each observation, its index in `points`
  Slots start{};                      ///< first guess of everything
  /// Further guesses, where one may lead astray.
  std::vector<Slots> more_starts;
  std::vector<std::string> warnings;

  /// First guess of the unknowns, as the solver sees them.
  std::vector<double> start_inner() const { return inner_of(start); }
  /// `count` starts, always the same ones: the guesses, then points spread around the first.
  std::vector<std::vector<double>> starts(int count) const;
  std::vector<double> inner_of(const Slots& guess) const;
  /// Takes a parameter out of the unknowns and holds it at a value.
  void hold(const std::string& name, double value);
  /// One exponent for cured heights and dead zones of a joint fit.
  void share_exponent();
};

/// Throws `InputError` when the measurements can't be fitted by the model at all.
PreparedFit prepare_fit(const Measurements& data, FitModel model, const FitOptions& options);

/// Makes the mean square of all weights 1.
void normalise_weights(Problem& problem);

/// Number of different values; measured intensities of one setting may differ in their last digits.
int count_different(std::vector<double> values);

/// Observations that were exposed alike.
struct Groups {
  std::vector<std::size_t> order;  ///< indices of observations, group by group
  std::vector<std::size_t> begin;  ///< of each group in `order`, and the end of the last
  std::size_t count() const { return begin.size() - 1; }
  std::span<const std::size_t> operator[](std::size_t group) const {
    return std::span(order).subspan(begin[group], begin[group + 1] - begin[group]);
  }
};
Groups replicate_groups(const std::vector<Observation>& all);

/// "heights.csv: line 7".
std::string place_of(const Origin& origin, const std::vector<std::string>& sources);

}  // namespace slicecorr::resins
