#include <algorithm>
#include <cmath>
#include <tuple>
#include <utility>

#include "correct/band_solvers.hpp"
#include "correct/in_bath.hpp"
#include "correct/level_search.hpp"
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
  const int layers = std::min(plan.layers, all);
  for (int n = 0; n < layers; ++n) {
    const auto k = static_cast<std::size_t>(n);
    const bool slit = n > 0 && n + 1 < plan.layers && coverage[k - 1] == kFull &&
                      coverage[k] == 0 && coverage[k + 1] == kFull;
    solved[k] = slit && plan.merge_one_slice_gaps ? kFull : coverage[k];
  }
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
    run.edge = edges.next(run.edge, n - run.node, c, height != 0 ? height : kEdgeAtNode);
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

std::unique_ptr<detail::BandSolver> make_solver(const CorrectionPlan& plan, std::size_t columns) {
  if (plan.model.inhibited) return detail::make_inhibited_solver(plan, columns);
  if (plan.model.mode == ExposureMode::layerwise) {
    return detail::make_layerwise_solver(plan, columns);
  }
  if (plan.model.bath_slices > 0) return detail::make_bath_solver(plan, columns);
  return detail::make_continuous_solver(plan, columns);
}

}  // namespace

struct BandCorrector::Impl {
  std::unique_ptr<detail::BandSolver> solver;
};

BandCorrector::BandCorrector(const CorrectionPlan& plan, std::size_t columns)
    : impl_(std::make_unique<Impl>(make_solver(plan, columns))) {}
BandCorrector::BandCorrector(const CorrectionPlan& plan, std::size_t columns, BandDoses doses)
    : impl_(std::make_unique<Impl>(detail::make_graded_solver(plan, columns, std::move(doses)))) {}
BandCorrector::~BandCorrector() = default;
BandCorrector::BandCorrector(BandCorrector&&) noexcept = default;
void BandCorrector::add_layer(const std::uint8_t* coverage, const std::uint8_t* heights) {
  impl_->solver->add_layer(coverage, heights);
}
void BandCorrector::solve(const Sink& sink) { impl_->solver->solve(sink, {}); }
void BandCorrector::solve(const Sink& sink, const TileSink& tiles) {
  if (!impl_->solver->has_tiles()) throw Error("this is not solved in tiles");
  impl_->solver->solve(sink, tiles);
}

std::vector<std::uint8_t> solve_column(const CorrectionPlan& plan,
                                       const std::vector<std::uint8_t>& coverage,
                                       const std::vector<std::uint8_t>& heights) {
  if (plan.model.inhibited) return detail::solve_inhibited_column(plan, coverage, heights);
  if (plan.model.mode == ExposureMode::layerwise) {
    return detail::solve_layerwise_column(plan, coverage, heights);
  }
  std::vector<std::uint8_t> levels(static_cast<std::size_t>(plan.all_layers));
  const detail::ContinuousPlan& p = *plan.continuous;
  detail::Edges edges(p);
  detail::LevelSearch search(edges);
  std::uint8_t chosen[detail::LevelSearch::kMost];
  int first = 0;
  const auto far = [&](int n) {
    const int k = n + plan.model.bath_slices;
    return k < plan.all_layers ? plan.levels.phi(levels[static_cast<std::size_t>(k)]) : 0.0;
  };
  const bool ends = plan.model.bath_slices > 0;
  walk_column(
      plan, edges, coverage, heights,
      [&](const detail::RunAt& run, int n, double below) {
        first = n;
        if (!ends) return search.choose(run, n, below, chosen);
        const detail::InBath bath(plan, run, n, below, far);
        return std::min(bath.slices, search.choose(run, n, bath.below, chosen));
      },
      [&](int n, double below) {
        const std::uint8_t index = chosen[first - n];
        levels[static_cast<std::size_t>(n)] = p.level_of[index];
        const double phi = p.levels.phi(index);
        return plan.model.step(ends ? plan.model.in_bath(phi, far(n)) : phi, below);
      });
  return levels;
}

std::vector<double> solve_column_exactly(const CorrectionPlan& plan,
                                         const std::vector<std::uint8_t>& coverage,
                                         const std::vector<std::uint8_t>& heights) {
  if (plan.model.inhibited) return detail::solve_inhibited_column_exactly(plan, coverage, heights);
  if (plan.model.mode == ExposureMode::layerwise)
    return detail::solve_layerwise_column_exactly(plan, coverage, heights);
  std::vector<double> phi(static_cast<std::size_t>(plan.all_layers));
  const detail::ContinuousPlan p(plan.model, plan.process, plan.all_layers, true);
  detail::Edges edges(p);
  const detail::LevelSearch search(edges);
  const auto far = [&](int n) {
    const int k = n + plan.model.bath_slices;
    return k < plan.all_layers ? phi[static_cast<std::size_t>(k)] : 0.0;
  };
  const bool ends = plan.model.bath_slices > 0;
  walk_column(
      plan, edges, coverage, heights,
      [&](const detail::RunAt& run, int n, double below) {
        if (ends) below -= plan.model.beyond * far(n) * p.b * p.per_a;
        phi[static_cast<std::size_t>(n)] = search.exact(run, n, below);
        return 1;
      },
      [&](int n, double below) {
        const double light = phi[static_cast<std::size_t>(n)];
        return plan.model.step(ends ? plan.model.in_bath(light, far(n)) : light, below);
      });
  return phi;
}

}  // namespace slicecorr
