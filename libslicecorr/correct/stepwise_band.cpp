// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <algorithm>
#include <memory>
#include <vector>

#include "base/coded_band.hpp"
#include "correct/band_solvers.hpp"
#include "correct/column_walk.hpp"
#include "slicecorr/error.hpp"

namespace slicecorr::detail {

namespace {

/// Solves slice by slice, all columns of a slice after each other: the levels of the slices that are
/// still in the bath stay at hand.
class StepwiseSolver final : public BandSolver {
 public:
  StepwiseSolver(const CorrectionPlan& plan, std::size_t columns)
      : plan_(plan),
        searches_(plan, false),
        coded_(columns),
        heights_(columns),
        left_alone_(columns),
        columns_(columns) {}

  void add_layer(const std::uint8_t* coverage, const std::uint8_t* heights,
                 const std::uint8_t* left_alone) override {
    if (coded_.slices() == plan_.layers && !coverage) {
      if (heights_.slices() == plan_.layers) heights_.append(heights);
      return;
    }
    if (coded_.slices() >= plan_.layers) throw Error("more layers than the plan has");
    coded_.append(coverage);
    heights_.append(heights);
    left_alone_.append(left_alone);
  }
  void solve(const BandCorrector::Sink& sink, const BandCorrector::TileSink& tiles) override;

 private:
  void find_runs();
  /// The grey level of slice n.
  std::uint8_t solve_slice(std::size_t column, int n, std::uint8_t left_alone);
  std::uint8_t& held(std::size_t column, int slice) {
    const auto k = static_cast<std::size_t>(slice % plan_.model.bath_slices);
    return held_[k * columns_ + column];
  }

  const CorrectionPlan& plan_;
  WalkSearches searches_;
  CodedBand coded_, heights_, left_alone_;
  std::size_t columns_;
  std::vector<ColumnWalk> each_;
  /// Levels of the slices in the bath, by slice modulo its depth and column.
  std::vector<std::uint8_t> held_;
};

void StepwiseSolver::find_runs() {
  std::vector<std::uint8_t> here(columns_), heights(columns_), left(columns_);
  for (int n = 0; n < plan_.all_layers; ++n) {
    coded_.read(n, here.data());
    left_alone_.read(n, left.data());
    heights_.read(n, heights.data());
    for (std::size_t i = 0; i < columns_; ++i) {
      const double light = left[i]
                               ? plan_.model.ratio(n) *
                                     plan_.levels.phi(level_of_pixel(left[i], plan_.levels.size()))
                               : 0.0;
      each_[i].add(plan_.model, n, here[i], heights[i], left[i] != 0, light);
    }
  }
  for (ColumnWalk& column : each_) column.begin(plan_.all_layers);
}

std::uint8_t StepwiseSolver::solve_slice(std::size_t column, int n, std::uint8_t left_alone) {
  const bool ends = plan_.model.bath_slices > 0;
  const auto far = [&](int k) {
    const bool shown = ends && k + plan_.model.bath_slices < plan_.all_layers;
    return shown
               ? plan_.model.ratio(k + plan_.model.bath_slices) * plan_.levels.phi(held(column, k))
               : 0.0;
  };
  ColumnWalk& walk = each_[column];
  const int level =
      walk.left_alone(n)
          ? level_of_pixel(left_alone, plan_.levels.size())
          : plan_.continuous->level_of[static_cast<std::size_t>(walk.choose(searches_, n, far))];
  walk.pass(plan_.model, n, plan_.model.ratio(n) * plan_.levels.phi(level), far(n));
  if (ends) held(column, n) = static_cast<std::uint8_t>(level);
  return static_cast<std::uint8_t>(level);
}

void StepwiseSolver::solve(const BandCorrector::Sink& sink, const BandCorrector::TileSink&) {
  if (coded_.slices() != plan_.layers) throw Error("the plan has more layers");
  if (plan_.all_layers <= 0) return;
  each_.assign(columns_, ColumnWalk{});
  held_.assign(static_cast<std::size_t>(plan_.model.bath_slices) * columns_, 0);
  find_runs();
  std::vector<std::uint8_t> out(columns_), coverage(columns_), left(columns_);
  for (int n = plan_.all_layers; n-- > 0;) {
    coded_.read(n, coverage.data());
    left_alone_.read(n, left.data());
    for (std::size_t i = 0; i < columns_; ++i) out[i] = solve_slice(i, n, left[i]);
    const bool dark = all_zero(out.data(), columns_) && all_zero(coverage.data(), columns_);
    sink(n, out.data(), coverage.data(), dark);
  }
}

}  // namespace

std::unique_ptr<BandSolver> make_stepwise_solver(const CorrectionPlan& plan, std::size_t columns) {
  return std::make_unique<StepwiseSolver>(plan, columns);
}

}  // namespace slicecorr::detail
