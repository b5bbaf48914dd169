// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <algorithm>
#include <cmath>
#include <tuple>
#include <utility>

#include "correct/band_solvers.hpp"
#include "correct/column_walk.hpp"
#include "correct/inhibited_plan.hpp"
#include "correct/level_search.hpp"
#include "correct/merged_slits.hpp"
#include "slicecorr/correct.hpp"
#include "slicecorr/error.hpp"

namespace slicecorr {

namespace {

/// Walks one column from the last slice to the first: `choose(run, n, below)` gives how many slices
/// it decided, `step(n, below)` the dose at the upper node of each.
template <typename Choose, typename Step>
void walk_column(const CorrectionPlan& plan, detail::Edges& edges,
                 const std::vector<std::uint8_t>& coverage,
                 const std::vector<std::uint8_t>& heights, Choose choose, Step step) {
  using detail::kFull;
  const int all = plan.all_layers;
  std::vector<std::uint8_t> solved(static_cast<std::size_t>(std::max(all, 0)), 0);
  std::copy_n(coverage.begin(), std::min(plan.layers, all), solved.begin());
  if (all <= 0) return;
  detail::RunAt run;
  run.edge = edges.platform(solved.front());
  run.lower = all;
  // Edges beyond an endless run can't be found from the edge below it: the column keeps its own
  // list.
  std::vector<std::pair<std::int32_t, std::int32_t>> passed;
  for (int n = 1; n < all; ++n) {
    const std::uint8_t c = solved[static_cast<std::size_t>(n)];
    if (c == solved[static_cast<std::size_t>(n - 1)]) continue;
    passed.emplace_back(run.edge, run.node);
    const auto node = static_cast<std::size_t>(n);
    const std::uint8_t height = node < heights.size() ? heights[node] : std::uint8_t{0};
    run.edge = edges.next(run.edge, n - run.node, c, height != 0 ? height : kEdgeAtNode, n);
    run.node = n;
  }
  double omega = 0;
  int left = 0;
  for (int n = all; n-- > 0;) {
    if (n < run.node) {
      run = detail::run_above(edges, run);
      std::tie(run.edge, run.node) = passed.back();
      passed.pop_back();
    }
    if (left == 0) left = choose(run, n, omega);
    --left;
    omega = step(n, omega);
  }
}

/// Levels of a column in continuous exposure that isn't plain: a band of one column.
std::vector<std::uint8_t> solve_stepwise(const CorrectionPlan& plan,
                                         const std::vector<std::uint8_t>& coverage,
                                         const std::vector<std::uint8_t>& heights) {
  BandCorrector band(plan, 1);
  for (std::size_t n = 0; n < static_cast<std::size_t>(std::max(plan.layers, 0)); ++n) {
    band.add_layer(&coverage[n], n < heights.size() ? &heights[n] : nullptr);
  }
  const auto last = static_cast<std::size_t>(plan.layers);
  if (last < heights.size()) band.add_layer(nullptr, &heights[last]);
  std::vector<std::uint8_t> levels(static_cast<std::size_t>(plan.all_layers));
  band.solve([&](int n, const std::uint8_t* level, const std::uint8_t*, bool) {
    levels[static_cast<std::size_t>(n)] = *level;
  });
  return levels;
}

/// The same without rounding to levels.
void walk_stepwise(const CorrectionPlan& plan, const std::vector<std::uint8_t>& coverage,
                   const std::vector<std::uint8_t>& heights, std::vector<double>& phi) {
  detail::WalkSearches searches(plan, true);
  detail::ColumnWalk walk;
  const auto cover = [&](int n) {
    return n >= 0 && n < plan.layers ? coverage[static_cast<std::size_t>(n)] : std::uint8_t{0};
  };
  for (int n = 0; n < plan.all_layers; ++n) {
    const auto k = static_cast<std::size_t>(n);
    walk.add(plan.model, n, cover(n), k < heights.size() ? heights[k] : std::uint8_t{0}, false,
             0.0);
  }
  walk.begin(plan.all_layers);
  const int bath = plan.model.bath_slices;
  const auto far = [&](int n) {
    const bool shown = bath > 0 && n + bath < plan.all_layers;
    return shown ? phi[static_cast<std::size_t>(n + bath)] : 0.0;
  };
  for (int n = plan.all_layers; n-- > 0;) {
    const double light = walk.exact(searches, n, far);
    phi[static_cast<std::size_t>(n)] = light;
    walk.pass(plan.model, n, light, far(n));
  }
}

std::unique_ptr<detail::BandSolver> solver_of(const CorrectionPlan& plan, std::size_t columns,
                                              bool leaves_alone) {
  if (plan.model.inhibited()) return detail::make_inhibited_solver(plan, columns);
  if (plan.tried) return detail::make_tried_solver(plan, columns);
  if (plan.model.mode == ExposureMode::layerwise) {
    return detail::make_layerwise_solver(plan, columns);
  }
  if (leaves_alone || !plan.model.is_plain()) return detail::make_stepwise_solver(plan, columns);
  return detail::make_continuous_solver(plan, columns);
}

std::unique_ptr<detail::BandSolver> with_slits(const CorrectionPlan& plan, std::size_t columns,
                                               std::unique_ptr<detail::BandSolver> solver) {
  if (!plan.merge_one_slice_gaps) return solver;
  return std::make_unique<detail::MergedSlits>(std::move(solver), plan.layers, columns);
}

}  // namespace

// Solvers that have even light keep what they are given.
// NOLINTNEXTLINE(performance-unnecessary-value-param)
void detail::BandSolver::keep_light(BandCorrector::ColumnLevels) {
  throw Error("even light needs UV light");
}

struct BandCorrector::Impl {
  explicit Impl(std::unique_ptr<detail::BandSolver> s) : solver(std::move(s)) {}
  std::unique_ptr<detail::BandSolver> solver;
};

BandCorrector::BandCorrector(const CorrectionPlan& plan, std::size_t columns, bool leaves_alone)
    : impl_(std::make_unique<Impl>(
          with_slits(plan, columns, solver_of(plan, columns, leaves_alone)))) {}
BandCorrector::BandCorrector(const CorrectionPlan& plan, std::size_t columns, BandDoses doses)
    : impl_(std::make_unique<Impl>(with_slits(
          plan, columns, detail::make_graded_solver(plan, columns, std::move(doses))))) {}
BandCorrector::~BandCorrector() = default;
BandCorrector::BandCorrector(BandCorrector&&) noexcept = default;
void BandCorrector::add_layer(const std::uint8_t* coverage, const std::uint8_t* heights,
                              const std::uint8_t* left_alone) {
  impl_->solver->add_layer(coverage, heights, left_alone);
}
void BandCorrector::keep_light(ColumnLevels most) { impl_->solver->keep_light(std::move(most)); }
void BandCorrector::solve(const Sink& sink) { impl_->solver->solve(sink, {}); }
void BandCorrector::solve(const Sink& sink, const TileSink& tiles) {
  if (!impl_->solver->has_tiles()) throw Error("this is not solved in tiles");
  impl_->solver->solve(sink, tiles);
}

std::vector<std::uint8_t> solve_column(const CorrectionPlan& plan,
                                       const std::vector<std::uint8_t>& coverage,
                                       const std::vector<std::uint8_t>& heights) {
  const std::vector<std::uint8_t> solved = detail::merged_slits(plan, coverage);
  if (plan.model.inhibited()) return detail::solve_inhibited_column(plan, solved, heights);
  if (plan.tried) return detail::solve_tried_column(plan, solved, heights);
  if (plan.model.mode == ExposureMode::layerwise) {
    return detail::solve_layerwise_column(plan, solved, heights);
  }
  if (!plan.model.is_plain()) return solve_stepwise(plan, solved, heights);
  std::vector<std::uint8_t> levels(static_cast<std::size_t>(plan.all_layers));
  const detail::ContinuousPlan& p = *plan.continuous;
  detail::Edges edges(p);
  detail::LevelSearch search(edges);
  std::uint8_t chosen[detail::LevelSearch::kMost];
  int first = 0;
  walk_column(
      plan, edges, solved, heights,
      [&](const detail::RunAt& run, int n, double below) {
        first = n;
        return search.choose(run, n, below, chosen);
      },
      [&](int n, double below) {
        const std::uint8_t index = chosen[first - n];
        levels[static_cast<std::size_t>(n)] = p.level_of[index];
        return plan.model.step(p.levels.phi(index), below);
      });
  return levels;
}

std::vector<double> solve_column_exactly(const CorrectionPlan& plan,
                                         const std::vector<std::uint8_t>& coverage,
                                         const std::vector<std::uint8_t>& heights) {
  const std::vector<std::uint8_t> solved = detail::merged_slits(plan, coverage);
  if (plan.model.inhibited() || plan.tried) {
    // Their rules are about levels: each is told by its phi.
    std::vector<double> phi;
    for (const std::uint8_t level : solve_column(plan, solved, heights)) {
      phi.push_back(plan.model.level_phi[level]);
    }
    return phi;
  }
  if (plan.model.mode == ExposureMode::layerwise)
    return detail::solve_layerwise_column_exactly(plan, solved, heights);
  std::vector<double> phi(static_cast<std::size_t>(plan.all_layers));
  if (!plan.model.is_plain()) {
    walk_stepwise(plan, solved, heights, phi);
    return phi;
  }
  const detail::ContinuousPlan p(plan.model, plan.process, plan.all_layers, true);
  detail::Edges edges(p);
  const detail::LevelSearch search(edges);
  walk_column(
      plan, edges, solved, heights,
      [&](const detail::RunAt& run, int n, double below) {
        phi[static_cast<std::size_t>(n)] = search.exact(run, n, below);
        return 1;
      },
      [&](int n, double below) {
        return plan.model.step(phi[static_cast<std::size_t>(n)], below);
      });
  return phi;
}

}  // namespace slicecorr
