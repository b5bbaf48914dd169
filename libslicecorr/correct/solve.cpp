#include <algorithm>
#include <cmath>
#include <utility>

#include "correct/band_solvers.hpp"
#include "correct/choose_level.hpp"
#include "slicecorr/correct.hpp"
#include "slicecorr/error.hpp"

namespace slicecorr {

using detail::Around;
using detail::Demand;

namespace {

/// Walks one column from the last slice to the first: `choose(goal, below)` gives the intensity.
template <typename Choose>
void walk_column(const CorrectionPlan& plan, const std::vector<std::uint8_t>& coverage, double edge,
                 Choose choose) {
  const auto at = [&](int layer) {
    const bool inside = layer >= 0 && layer < plan.layers;
    return inside ? coverage[static_cast<std::size_t>(layer)] : std::uint8_t{0};
  };
  const auto around = [&](int n) {
    return Around{at(n - 3), at(n - 2), at(n - 1), at(n), at(n + 1)};
  };
  std::vector<Demand> demands;
  Demand demand;
  for (int n = 0; n < plan.all_layers; ++n) {
    demand = detail::next_demand(plan, n, around(n), demand);
    demands.push_back(demand);
  }
  double omega = 0;
  for (int n = plan.all_layers; n-- > 0;) {
    const auto k = static_cast<std::size_t>(n);
    const double phi =
        choose(k, detail::goal_at(plan, n, around(n), demands[k], omega, edge), omega);
    omega = plan.model.step(phi, omega);
  }
}

std::unique_ptr<detail::BandSolver> make_solver(const CorrectionPlan& plan, std::size_t columns) {
  if (plan.model.inhibited) return detail::make_inhibited_solver(plan, columns);
  if (plan.model.mode == ExposureMode::layerwise) {
    return detail::make_layerwise_solver(plan, columns);
  }
  return detail::make_continuous_solver(plan, columns);
}

}  // namespace

struct BandCorrector::Impl {
  std::unique_ptr<detail::BandSolver> solver;
};

BandCorrector::BandCorrector(const CorrectionPlan& plan, std::size_t columns)
    : impl_(std::make_unique<Impl>(make_solver(plan, columns))) {}
BandCorrector::~BandCorrector() = default;
BandCorrector::BandCorrector(BandCorrector&&) noexcept = default;
void BandCorrector::add_layer(const std::uint8_t* coverage) { impl_->solver->add_layer(coverage); }
void BandCorrector::solve(const Sink& sink) { impl_->solver->solve(sink, {}); }
void BandCorrector::solve(const Sink& sink, const TileSink& tiles) {
  if (!impl_->solver->has_tiles()) throw Error("only plain models are solved in tiles");
  impl_->solver->solve(sink, tiles);
}

std::vector<std::uint8_t> solve_column(const CorrectionPlan& plan,
                                       const std::vector<std::uint8_t>& coverage) {
  if (plan.model.inhibited) return detail::solve_inhibited_column(plan, coverage);
  if (!plan.model.is_plain()) return detail::solve_layerwise_column(plan, coverage);
  std::vector<std::uint8_t> levels(static_cast<std::size_t>(plan.all_layers));
  walk_column(plan, coverage, 1.0 + detail::kMargin,
              [&](std::size_t n, const detail::Goal& goal, double below) {
                const int level = detail::choose_level(plan, goal, below);
                levels[n] = static_cast<std::uint8_t>(level);
                return plan.levels.phi(level);
              });
  return levels;
}

std::vector<double> solve_column_exactly(const CorrectionPlan& plan,
                                         const std::vector<std::uint8_t>& coverage) {
  if (plan.model.inhibited) return detail::solve_inhibited_column_exactly(plan, coverage);
  if (!plan.model.is_plain()) return detail::solve_layerwise_column_exactly(plan, coverage);
  std::vector<double> phi(static_cast<std::size_t>(plan.all_layers));
  walk_column(plan, coverage, 1.0, [&](std::size_t n, const detail::Goal& goal, double below) {
    phi[n] = std::clamp(detail::intensity_for(plan.model, std::max(goal.aim, goal.least), below),
                        plan.model.phi_min(), plan.model.phi_max());
    return phi[n];
  });
  return phi;
}

}  // namespace slicecorr
