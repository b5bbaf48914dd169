// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <algorithm>
#include <cstddef>
#include <memory>
#include <utility>

#include "correct/band_solvers.hpp"
#include "correct/column_band.hpp"
#include "correct/inhibited_plan.hpp"
#include "correct/layer_column.hpp"
#include "correct/merged_slits.hpp"
#include "correct/tried_column.hpp"
#include "correct/walked_column.hpp"
#include "slicecorr/correct.hpp"
#include "slicecorr/error.hpp"

namespace slicecorr {

namespace {

/// What a band needs to know of columns whose doses are sums of light.
detail::ColumnFacts facts_of_sums(const CorrectionPlan& plan) {
  detail::ColumnFacts facts;
  facts.layers = plan.layers;
  facts.all_layers = plan.all_layers;
  facts.lower_at_window = plan.model.mode == ExposureMode::layerwise;
  facts.height_steps = 254;  // as they are (edge_height_slices)
  facts.solved = std::make_shared<detail::SolvedColumns>();
  facts.levels = plan.levels.size();
  facts.wants_ones = true;
  facts.keeps_caps = false;
  return facts;
}

/// The solver of a plan's columns, of any model but UV light.
detail::SolvedBy solver_of(const CorrectionPlan& plan, bool wants_doses) {
  if (plan.tried) return {detail::make_tried_column(*plan.tried), plan.tried->facts()};
  const detail::ColumnFacts facts = facts_of_sums(plan);
  const bool layers = plan.model.mode == ExposureMode::layerwise;
  return {layers ? detail::make_layer_column(plan, wants_doses)
                 : detail::make_walked_column(plan, wants_doses),
          facts};
}

std::unique_ptr<detail::ColumnBand> band_of(const CorrectionPlan& plan, std::size_t columns,
                                            bool wants_doses) {
  detail::SolvedBy by = solver_of(plan, wants_doses);
  return std::make_unique<detail::ColumnBand>(std::move(by.solver), by.facts, columns);
}

std::unique_ptr<detail::BandSolver> band_solver(const CorrectionPlan& plan, std::size_t columns,
                                                bool leaves_alone) {
  if (plan.model.inhibited()) return detail::make_inhibited_solver(plan, columns);
  if (plan.model.is_plain() && !leaves_alone) return detail::make_continuous_solver(plan, columns);
  return band_of(plan, columns, false);
}

std::unique_ptr<detail::BandSolver> band_solver(const CorrectionPlan& plan, std::size_t columns,
                                                BandDoses doses) {
  if (plan.model.inhibited()) {
    if (!plan.inhibited->even) {
      return detail::make_inhibited_solver(plan, columns, std::move(doses));
    }
    throw Error("doses are wanted where light is even over the flow");
  }
  auto band = band_of(plan, columns, true);
  band->want(std::move(doses));
  return band;
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
          with_slits(plan, columns, band_solver(plan, columns, leaves_alone)))) {}
BandCorrector::BandCorrector(const CorrectionPlan& plan, std::size_t columns, BandDoses doses)
    : impl_(std::make_unique<Impl>(
          with_slits(plan, columns, band_solver(plan, columns, std::move(doses))))) {}
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
  const detail::SolvedBy by = solver_of(plan, false);
  return detail::solve_alone(*by.solver, by.facts, solved, heights);
}

std::vector<std::uint8_t> solve_graded_column(const CorrectionPlan& plan, const DoseScale& scale,
                                              const std::vector<std::uint8_t>& coverage,
                                              const std::vector<std::uint8_t>& doses,
                                              const std::vector<std::uint8_t>& heights) {
  if (plan.model.inhibited() || plan.tried) {
    throw Error("doses are wanted of a model that is not one of sums of light");
  }
  detail::ColumnBounds bounds;
  bounds.side = scale.side;
  for (const std::uint8_t byte : doses) bounds.wanted.push_back(scale.dose[byte]);
  bounds.wanted.resize(static_cast<std::size_t>(std::max(plan.layers, 0)), 1.0);
  const detail::SolvedBy by = solver_of(plan, true);
  const std::vector<std::uint8_t> solved = detail::merged_slits(plan, coverage);
  return by.solver->solve(detail::runs_of(by.facts, solved, heights), bounds);
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
  const auto runs = detail::runs_of(facts_of_sums(plan), solved, heights);
  return plan.model.mode == ExposureMode::layerwise ? detail::solve_layers_exactly(plan, runs)
                                                    : detail::solve_walked_exactly(plan, runs);
}

}  // namespace slicecorr
