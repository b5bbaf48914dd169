// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "correct/inhibited_column.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

#include "correct/column_band.hpp"
#include "correct/even_column.hpp"
#include "correct/inhibited_doses.hpp"
#include "correct/inhibited_judge.hpp"
#include "correct/inhibited_polish.hpp"
#include "correct/inhibited_rule.hpp"

namespace slicecorr::detail {

struct InhibitedColumn::Impl {
  explicit Impl(const InhibitedPlan& p)
      : plan(p),
        design(p),
        doses(p),
        rule(p, design, doses, caps),
        judge(p, design, doses),
        polish(p, design, doses, caps) {
    if (p.even) even.emplace(p);
  }

  /// What came of levels that were tried.
  struct Outcome {
    bool better = false;   ///< than all before; they are kept
    bool perfect = false;  ///< all of their edges and voxels are right
  };
  Outcome keep_if_better();
  Outcome try_lags();
  Outcome try_lags_and_aim();
  bool aim_edges();
  void try_one_lag_for_all();
  void try_a_lag_for_each();
  void raise_demands();
  bool raise_around_dips(double times, bool edges_too);
  void polish_best();
  bool has_full_features() const;
  bool even_light_does(const std::vector<CoverageRun>& runs);
  bool greys_have_theirs() const;
  void search(const std::vector<CoverageRun>& runs);

  const InhibitedPlan& plan;
  std::vector<Level> caps;  ///< highest levels, per slice; empty: those of the plan
  ColumnDesign design;
  ColumnDoses doses;
  LevelRule rule;
  ColumnJudge judge;
  ColumnPolish polish;
  std::optional<EvenColumn> even;  ///< where light is even over the flow

  std::vector<Level> best_of_all;  ///< for all aims
  // The best levels for the present aims.
  std::vector<Level> best;
  std::vector<ColumnJudge::Dip> best_dips;
  double least_um = 0;  ///< their score
  int wrong_voxels = 0;
  bool perfect = false;
  bool greys_right = false;  ///< by even light
  std::vector<int> lags;     ///< those of the best levels, per feature
};

InhibitedColumn::Impl::Outcome InhibitedColumn::Impl::keep_if_better() {
  const ColumnJudge::Score score = judge.score(least_um);
  if (score.um >= least_um) return {};
  least_um = score.um;
  wrong_voxels = score.wrong_voxels;
  best = doses.levels();
  best_dips = judge.dips();
  return {true, score.perfect};
}

/// Chooses levels with the lags that the features have.
InhibitedColumn::Impl::Outcome InhibitedColumn::Impl::try_lags() {
  rule.choose();
  // Features that light each other are chosen twice more, knowing what the others show.
  if (design.features.size() > 1 && rule.choose_again()) {
    const Outcome second = keep_if_better();
    rule.choose_again();
    const Outcome third = keep_if_better();
    return third.better ? third : second;
  }
  return keep_if_better();
}

/// The same, and where the design has edge heights, has the nodes of these edges demand what brings
/// the edges there, round by round.
InhibitedColumn::Impl::Outcome InhibitedColumn::Impl::try_lags_and_aim() {
  Outcome outcome = try_lags();
  if (!design.has_heights) return outcome;
  const std::vector<double> demand = design.demand;
  for (int round = 0; round < plan.tuning.aim_rounds && !outcome.perfect && aim_edges(); ++round) {
    const Outcome next = try_lags();
    outcome = {outcome.better || next.better, next.perfect};
  }
  design.demand = demand;
  return outcome;
}

/// Adds to the demands of edges with heights what the present levels lack there; false where none
/// lacks anything.
bool InhibitedColumn::Impl::aim_edges() {
  bool any = false;
  for (const ColumnDesign::Edge& edge : design.edges) {
    if (edge.aim == 0) continue;
    const double lacks = 1.0 - doses.beside(edge.node, edge.aim);
    if (std::abs(lacks) < plan.tuning.aim_enough) continue;
    double& demand = design.demand[static_cast<std::size_t>(edge.node)];
    demand = std::max(plan.tuning.aim_least, demand + lacks);
    any = true;
  }
  return any;
}

/// Tries lags, the same for all features, until one does or more of them would win nothing.
void InhibitedColumn::Impl::try_one_lag_for_all() {
  lags.assign(design.features.size(), plan.lags.front());
  int in_vain = 0;
  for (const int lag : plan.lags) {
    for (ColumnDesign::Feature& f : design.features) f.lag = lag;
    const Outcome outcome = try_lags_and_aim();
    if (outcome.better) {
      perfect = outcome.perfect;
      lags.assign(lags.size(), lag);
      in_vain = 0;
    } else {
      ++in_vain;
    }
    if (perfect || (in_vain >= plan.tuning.lags_in_vain && wrong_voxels == 0)) return;
  }
}

void InhibitedColumn::Impl::try_a_lag_for_each() {
  for (std::size_t f = lags.size(); f-- > 0 && !perfect;) {
    for (const int lag : plan.lags) {
      if (lag == lags[f]) continue;
      for (std::size_t i = 0; i < lags.size(); ++i) {
        design.features[i].lag = i == f ? lag : lags[i];
      }
      const Outcome outcome = try_lags_and_aim();
      if (!outcome.better) continue;
      lags[f] = lag;
      perfect = outcome.perfect;
    }
  }
}

/// Where features come apart, has the nodes around their dips demand more, until they hold.
void InhibitedColumn::Impl::raise_demands() {
  const InhibitedTuning& t = plan.tuning;
  for (int round = 0; round < t.raise_rounds && !best_dips.empty(); ++round) {
    const bool edges_too = round >= t.raise_rounds_inside;
    if (!raise_around_dips(1.0 + t.raise_growth * round, edges_too) && edges_too) break;
    for (std::size_t f = 0; f < lags.size(); ++f) design.features[f].lag = lags[f];
    const Outcome outcome = try_lags();
    if (outcome.better) perfect = outcome.perfect;
  }
}

/// Has the nodes around the dips of the best levels demand `times` as much more as is missing
/// there, edges only with `edges_too`; false if none of the nodes can.
bool InhibitedColumn::Impl::raise_around_dips(double times, bool edges_too) {
  bool any = false;
  for (const ColumnJudge::Dip& dip : best_dips) {
    for (const int k : {dip.layer, dip.layer + 1}) {
      const bool edge = !design.full(k) || (k > 0 && !design.full(k - 1));
      if (edge && !edges_too) continue;
      design.demand[static_cast<std::size_t>(k)] +=
          times * ((1.0 - dip.least) + plan.tuning.raise_extra_dose);
      any = true;
    }
  }
  return any;
}

void InhibitedColumn::Impl::polish_best() {
  const bool sampled = !plan.dark_fine.empty();
  for (const double weight : plan.tuning.dip_weights) {
    doses.take(best, sampled);
    polish.descend(weight);
    keep_if_better();
    // A second time only where features still have dips, which only sampled doses can show.
    if (!sampled || judge.dips().empty()) return;
  }
}

/// Whether every feature has a node that demands all of its dose: others are no more than grey.
bool InhibitedColumn::Impl::has_full_features() const {
  return std::all_of(design.features.begin(), design.features.end(), [&](const auto& f) {
    return std::any_of(design.demand.begin() + f.upper, design.demand.begin() + f.lower + 1,
                       [](double demand) { return demand >= 1; });
  });
}

/// Gives the column even light, and its edges what brings them to their places. Whether that is right;
/// else it is one try among others.
bool InhibitedColumn::Impl::even_light_does(const std::vector<CoverageRun>& runs) {
  doses.take(even->levels(runs, caps), false);
  for (int round = 0;; ++round) {
    const Outcome outcome = keep_if_better();
    if (outcome.better) greys_right = greys_have_theirs();
    perfect = outcome.perfect && greys_right;
    if (perfect && best_dips.empty()) return true;
    if (round == plan.tuning.even_rounds) return false;
    bool any = false;
    for (const ColumnDesign::Edge& edge : design.edges) {
      const double lacks = 1.0 - doses.beside(edge.node, edge.aim);
      if (std::abs(lacks) < plan.tuning.aim_enough) continue;
      even->more_at(edge.node) += lacks;
      any = true;
    }
    if (!any) return false;
    doses.take(even->levels_again(runs), false);
  }
}

/// Whether grey nodes have the dose that they demand.
bool InhibitedColumn::Impl::greys_have_theirs() const {
  for (std::size_t k = 0; k < design.demand.size(); ++k) {
    const double demand = design.demand[k];
    if (demand <= 0 || demand >= 1) continue;
    if (doses.node(static_cast<int>(k)) < demand - plan.tuning.even_grey_lacks) return false;
  }
  return true;
}

/// Finds the best levels for the design's aims.
void InhibitedColumn::Impl::search(const std::vector<CoverageRun>& runs) {
  least_um = std::numeric_limits<double>::infinity();
  perfect = false;
  if (even && !doses.has_floors() && has_full_features()) {
    if (even_light_does(runs) || plan.tuning.as_planned) return;
    // Near to what was planned before anything else.
    if (greys_right) {
      polish_best();
      if (wrong_voxels == 0 && best_dips.empty()) return;
    } else {
      least_um = std::numeric_limits<double>::infinity();
    }
  }
  try_one_lag_for_all();
  // Lags of their own help features without room; of heights they mend little.
  const bool fits = perfect || (design.has_heights && wrong_voxels == 0);
  // Of even light edges alone are no reason to leave what was planned.
  if (!fits && (!even || wrong_voxels > 0) && lags.size() > 1 &&
      lags.size() <= plan.tuning.own_lag_features) {
    try_a_lag_for_each();
  }
  raise_demands();
  if (!perfect || !best_dips.empty()) polish_best();
}

namespace {

/// The floors of a column whose features are to hold at every lift. Greys hold where the slicer's light does.
std::vector<Level> held_floors(const InhibitedPlan& plan, const std::vector<CoverageRun>& runs,
                               const ColumnBounds& bounds) {
  std::vector<Level> floors = bounds.floors;
  floors.resize(static_cast<std::size_t>(plan.all_layers), 0);
  for (const CoverageRun& run : runs) {
    const int slicers = level_of_pixel(run.coverage, plan.kernel->levels());
    for (int n = run.first; n < std::min(run.end, plan.all_layers); ++n) {
      const auto at = static_cast<std::size_t>(n);
      // The first layer over a gap hangs on its neighbours.
      const bool film = n == run.first && n > 0;
      const int holds = std::min({static_cast<int>(film ? plan.film_own[at] : plan.holding_own[at]),
                                  slicers, plan.cap_of(n, bounds.caps)});
      floors[at] = std::max(floors[at], static_cast<Level>(holds));
    }
  }
  return floors;
}

}  // namespace

InhibitedColumn::InhibitedColumn(const InhibitedPlan& plan) : impl_(std::make_unique<Impl>(plan)) {}
InhibitedColumn::~InhibitedColumn() = default;

const std::vector<Level>& InhibitedColumn::solve(const std::vector<CoverageRun>& runs,
                                                 const ColumnBounds& bounds) {
  Impl& s = *impl_;
  s.caps = bounds.caps;
  s.design.ask(bounds);
  s.doses.set_floors(s.plan.holding_own.empty() ? bounds.floors
                                                : held_floors(s.plan, runs, bounds));
  double least_um = std::numeric_limits<double>::infinity();
  for (const double farthest : s.plan.tuning.farthest_edge_layers) {
    s.design.read(runs, farthest);
    s.search(runs);
    if (s.least_um < least_um) {
      least_um = s.least_um;
      s.best_of_all = s.best;
    }
    if (!s.design.has_heights || s.wrong_voxels == 0) break;
  }
  return s.best_of_all;
}

std::unique_ptr<BandSolver> make_inhibited_solver(const CorrectionPlan& plan, std::size_t columns) {
  const InhibitedPlan& p = *plan.inhibited;
  return std::make_unique<ColumnBand>(std::make_unique<InhibitedColumn>(p), p.facts(), columns);
}

namespace {

/// Columns that want doses, with a plan of their own for these.
class WantingColumn final : public ColumnSolver {
 public:
  WantingColumn(const InhibitedPlan& plan, double most)
      : plan_(plan.for_doses(most)), column_(plan_) {}
  const std::vector<Level>& solve(const std::vector<CoverageRun>& runs,
                                  const ColumnBounds& bounds) override {
    return column_.solve(runs, bounds);
  }

 private:
  InhibitedPlan plan_;
  InhibitedColumn column_;
};

}  // namespace

std::unique_ptr<BandSolver> make_inhibited_solver(const CorrectionPlan& plan, std::size_t columns,
                                                  BandDoses doses) {
  const InhibitedPlan& p = *plan.inhibited;
  auto column = std::make_unique<WantingColumn>(p, doses.scale->greatest() * p.node_over_middle);
  auto band = std::make_unique<ColumnBand>(std::move(column), p.facts(), columns);
  band->want(std::move(doses));
  return band;
}

std::vector<std::uint8_t> solve_inhibited_column(const CorrectionPlan& plan,
                                                 const std::vector<std::uint8_t>& coverage,
                                                 const std::vector<std::uint8_t>& heights) {
  InhibitedColumn column(*plan.inhibited);
  return solve_alone(column, plan.inhibited->facts(), coverage, heights);
}

}  // namespace slicecorr::detail
