// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "correct/column_walk.hpp"

#include <algorithm>
#include <cmath>

#include "slicecorr/units.hpp"

namespace slicecorr::detail {

namespace {

/// So many nodes from an edge features are told what they must have there.
constexpr int kInside = 12;

CureModel multiplied(CureModel model, double factor) {
  for (double& phi : model.level_phi) phi *= factor;
  return model;
}

Process with_cap(Process process, double factor) {
  process.omega_max = std::min(process.omega_max * factor, kNoCap);
  return process;
}

}  // namespace

MirroredPlans::MirroredPlans(const CureModel& model, const Process& process, int slices, bool exact,
                             std::shared_ptr<const ContinuousPlan> first) {
  factors.push_back(1);
  of_node.resize(static_cast<std::size_t>(std::min(slices + 1, model.mirrored_slices)));
  // From the far end, where factors are least.
  for (std::size_t n = of_node.size(); n-- > 0;) {
    const double factor = model.returned(static_cast<double>(n));
    if (factor - factors.back() > kAlike) factors.push_back(factor);
    of_node[n] = static_cast<std::int32_t>(factors.size()) - 1;
  }
  const auto last_of = [&](std::int32_t index) {
    const auto found = std::find(of_node.rbegin(), of_node.rend(), index);
    return static_cast<int>(of_node.rend() - found) - 1;
  };
  if (!first) first = std::make_shared<const ContinuousPlan>(model, process, slices, exact);
  plans.push_back(std::move(first));
  for (std::size_t i = 1; i < factors.size(); ++i) {
    // Each layer has a factor of its own: caps are seen to there.
    auto plan = std::make_shared<ContinuousPlan>(multiplied(model, factors[i]),
                                                 with_cap(process, factors[i]), slices, exact,
                                                 plans.front().get());
    const int node = last_of(static_cast<std::int32_t>(i));
    // Between two nodes the dose may be a little less than at both.
    const double fall = model.eta * units::kLn10;
    const double dip = fall * fall * (factors[i] - 1);
    plan->mirrored = true;
    for (int j = 0; j < kInside; ++j) {
      plan->prints_inside.push_back(plan->prints * (1 + dip) * factors[i] /
                                    model.returned(node + j));
    }
    plans.push_back(std::move(plan));
  }
}

WalkSearches::WalkSearches(const CorrectionPlan& plan, bool exact, bool shelves)
    : plan_(plan),
      shelves_(shelves),
      plans_(!exact && plan.mirrored
                 ? plan.mirrored
                 : std::make_shared<const MirroredPlans>(plan.model, plan.process, plan.all_layers,
                                                         exact, exact ? nullptr : plan.continuous)),
      searches_(plans_->factors.size()) {}

WalkSearches::Search& WalkSearches::of(std::size_t index) {
  std::unique_ptr<Search>& one = searches_[index];
  if (!one) one = std::make_unique<Search>(*plans_->plans[index], shelves_);
  return *one;
}

void ColumnWalk::add(const CoverageRun& covered) {
  const bool joined = !runs_.empty() && !runs_.back().left_alone;
  if (joined && runs_.back().cover == covered.coverage) return;
  ColumnRun run;
  run.node = covered.first;
  run.cover = covered.coverage;
  const bool edge = joined && opposite(runs_.back().cover, covered.coverage);
  if (edge && covered.upper_height != 0) run.height = covered.upper_height;
  runs_.push_back(run);
}

void ColumnWalk::add_left_alone(const CureModel& model, int slice, double light) {
  if (runs_.empty() || !runs_.back().left_alone) {
    ColumnRun run;
    run.node = slice;
    run.cover = 0;
    run.left_alone = true;
    runs_.push_back(run);
  }
  ColumnRun& run = runs_.back();
  const double left =
      model.heights.alike()
          ? std::pow(model.a, slice - run.node)
          : std::exp((model.depth(run.node) - model.depth(slice)) * model.eta * units::kLn10);
  run.light += model.one_minus_a_of(slice) * left * light;
}

std::int32_t ColumnWalk::edge_of(WalkSearches& all, std::size_t index) {
  const auto search = static_cast<std::int32_t>(index);
  Edges& edges = all.of(index).edges;
  const double factor = all.plans().factors[index];
  // From the last run on whose edge this search knows.
  std::size_t i = runs_.size() - 1;
  while (i > 0 && runs_[i].search != search) --i;
  if (runs_[i].search != search) {
    const std::int32_t id =
        runs_[i].left_alone ? Edge::kNone : edges.platform(runs_[i].cover, runs_[i].node);
    runs_[i].know(search, id);
  }
  while (i + 1 < runs_.size()) {
    const ColumnRun& run = runs_[i];
    ColumnRun& next = runs_[++i];
    const int slices = next.node - run.node;
    if (run.left_alone) {
      // At its upper end doses count for more than where the search looks from, and for more still in
      // the last layer of a gap there.
      const bool gap = i > 1 && runs_[i - 2].cover == 0;
      const double there = factor / all.model().returned(run.node - (gap ? 1 : 0));
      next.know(search,
                edges.through(run.edge, slices, run.light * factor, there, next.cover, next.node));
    } else {
      next.know(search, edges.next(run.edge, slices, next.left_alone ? run.cover : next.cover,
                                   next.height, next.node));
    }
  }
  return runs_.back().edge;
}

RunAt ColumnWalk::run_for(WalkSearches& all, std::size_t index) {
  if (known_ == static_cast<std::int32_t>(index)) return run_;
  known_ = static_cast<std::int32_t>(index);
  const ColumnRun& here = runs_.back();
  RunAt run;
  run.edge = edge_of(all, index);
  run.node = here.node;
  run.lower = lower_;
  if (passed_ > 0) {
    // To what is left alone a run has no edge: it might as well go on.
    run.below = before_.left_alone ? here.cover : before_.cover;
    run.lower_height = before_.height;
    const bool slit = passed_ > 1 && !before_.left_alone && !after_.left_alone &&
                      before_.cover == 0 && after_.node - before_.node == 1;
    run.slit_below = slit && here.cover == kFull && after_.cover == kFull;
  }
  return run_ = run;
}

int ColumnWalk::seen_to(const WalkSearches& all, const RunAt& run, int n, double far, int level,
                        bool near) const {
  if (runs_.back().cover != kFull) return level;
  const CureModel& model = all.model();
  const ContinuousPlan& far_plan = *all.plans().plans.front();
  const LevelTable& levels = far_plan.levels;
  const double taken = model.bath_slices > 0 ? model.beyond * far : 0.0;
  const double at_node = model.returned(n), at_middle = model.returned(n + 0.5);
  const auto light = [&](int l) { return model.ratio(n) * levels.phi(l) - taken; };
  const auto node = [&](int l) { return at_node * model.step_in(n, light(l), omega_); };
  const auto prints = [&](int l) {
    return node(l) >= far_plan.prints &&
           at_middle * model.middle_in(n, light(l), omega_) >= far_plan.prints;
  };
  const Process& process = all.plan().process;
  const bool capped = process.omega_max < kNoCap && (run.node > 0 || process.cap_platform_features);
  // Between 1 and a lower cap no level could hold the dose.
  const double cap = std::max(process.omega_max, 1.0 + 3.0 * at_node * far_plan.largest_step);
  while (capped && level > 0 && node(level) > cap && prints(level - 1)) --level;
  while (!near && level + 1 < levels.size() && !prints(level)) ++level;
  return level;
}

}  // namespace slicecorr::detail
