// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file problem.hpp
/// Widths and edges as least squares.
///
/// For one thread at a time.
#pragma once

#include <vector>

#include "fit/least_squares.hpp"
#include "slicecorr/resins/spread_fit.hpp"
#include "spread/model.hpp"

namespace slicecorr::resins {

/// A parameter of `SpreadState`.
struct KnownSpread {
  const char* name;
  const char* unit;
  /// What else has to be measured where widths, or edges, leave it open.
  const char* of_widths;
  const char* of_edges;
  double SpreadState::*field;
};
const std::vector<KnownSpread>& known_spread();
/// Null: there is none of this name.
const KnownSpread* known_spread(const std::string& name);

/// What both have in common: the parameters that are fitted come first among the unknowns.
class SpreadProblem : public LeastSquares {
 public:
  SpreadState start;
  std::vector<const KnownSpread*> fitted;

  /// `scale_um`: about how far light spreads; `deepest_um`: of what is measured.
  SpreadProblem(double scale_um, double deepest_um)
      : scale_um_(scale_um), deepest_um_(deepest_um) {}
  SpreadState at(const double* values) const;
  /// The parameters of a state, then what the problem itself adds for it.
  std::vector<double> values_of(const SpreadState& state) const;
  double step(std::size_t unknown, double value) const override;
  virtual std::size_t own_unknowns() const { return 0; }
  std::size_t unknowns() const override { return fitted.size() + own_unknowns(); }
  virtual void own_values(const SpreadState&, std::vector<double>&) const {}
  double scale_um() const { return scale_um_; }
  double deepest_um() const { return deepest_um_; }

 protected:
  virtual double own_step(std::size_t) const { return 0; }

 private:
  double scale_um_, deepest_um_;
};

/// Measured less found of widths, over their scatter.
class WidthProblem final : public SpreadProblem {
 public:
  struct Row {
    std::size_t index = 0;  ///< among the rows measured
    Exposure exposure;
    double designed_um = 0, printed_um = 0, error_um = 1;
  };
  WidthProblem(std::vector<Row> all, double scale_um, double deepest_um)
      : SpreadProblem(scale_um, deepest_um), rows(std::move(all)) {}
  std::vector<Row> rows;  ///< that count

  std::size_t count() const override { return rows.size(); }
  bool residuals(const double* values, double* out) const override;
};

/// Measured less found of edges, in shares of their steps, by how many pixels there are.
class EdgeProblem final : public SpreadProblem {
 public:
  struct Sample {
    std::size_t edge = 0, sample = 0;  ///< which
    double weight = 1;
  };
  EdgeProblem(const std::vector<KnifeEdge>& edges, double scale_um, double deepest_um);
  std::vector<Sample> samples;  ///< that count

  /// Dark side, bright side and place of an edge, among the unknowns.
  struct Place {
    double low = 0, high = 1, at_um = 0;
  };
  Place place_of(const double* values, std::size_t edge) const;
  double found(const SpreadState& state, const Place& place, const Sample& sample) const;
  /// By which residuals of an edge are divided.
  double step_of(std::size_t edge) const { return guesses_[edge].high - guesses_[edge].low; }
  double sigma_guess_um() const { return sigma_guess_um_; }

  std::size_t count() const override { return samples.size(); }
  std::size_t own_unknowns() const override { return 3 * edges_.size(); }
  void own_values(const SpreadState& state, std::vector<double>& values) const override;
  bool residuals(const double* values, double* out) const override;
  bool jacobian(const double* values, Eigen::MatrixXd& out) const override;

 protected:
  double own_step(std::size_t unknown) const override;

 private:
  double share(const SpreadState& state, double at_um, const Sample& sample) const;
  bool holds_at(const SpreadState& state) const;

  const std::vector<KnifeEdge>& edges_;
  std::vector<Place> guesses_;
  double sigma_guess_um_ = 1;
};

}  // namespace slicecorr::resins
