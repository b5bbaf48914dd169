// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Levels of continuous exposure, slice by slice, where the search alone doesn't know all that counts:
/// in a bath that ends, below a platform that sends light back, beside what is left alone, and where
/// slices count for more than others.
///
/// - A slice counts for phi_n - a^B phi_(n + B) (cure.hpp), and what is taken is known when the slice
///   is solved: the search is told, of all slices that it looks at.
/// - Light from the platform multiplies the dose at each edge by a factor of its own. Each run is
///   solved as if all doses were multiplied by that of its upper edge, whose dose is then right; what
///   else the layers of the run ask is seen to slice by slice.
/// - What is left alone shows the light that it is given and asks nothing. The runs before it must
///   leave what those behind it need.
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "correct/column_solver.hpp"
#include "correct/level_search.hpp"
#include "slicecorr/correct.hpp"

namespace slicecorr::detail {

/// The plans of the nodes that light from the platform reaches, and their factors.
struct MirroredPlans {
  /// Factors that differ by less than `kAlike` share a plan: that of the least.
  static constexpr double kAlike = 5e-7;
  /// `first`: the plan without a factor; null: made here.
  MirroredPlans(const CureModel& model, const Process& process, int slices, bool exact,
                std::shared_ptr<const ContinuousPlan> first);
  /// Of the plans; the first is 1.
  std::vector<double> factors;
  std::vector<std::shared_ptr<const ContinuousPlan>> plans;
  std::vector<std::int32_t> of_node;  ///< nodes after the last have plan 0
  std::size_t at(int node) const {
    const auto n = static_cast<std::size_t>(node);
    return n < of_node.size() ? static_cast<std::size_t>(of_node[n]) : 0;
  }
};

/// Consecutive slices of a column of one coverage, or left alone; first slice first.
struct ColumnRun {
  std::int32_t node = 0;  ///< of its upper end: its first slice
  std::uint8_t cover = 0;
  std::uint8_t height = kEdgeAtNode;  ///< edge height of its upper end
  bool left_alone = false;
  double light = 0;  ///< left alone: dose that its slices make at its upper end
  /// Its upper edge as one of the searches has it: the one that was asked last; -1: none was.
  std::int32_t search = -1, edge = Edge::kNone;
  void know(std::int32_t by_search, std::int32_t its_edge) {
    search = by_search;
    edge = its_edge;
  }
};

/// The searches of a band, one per plan. Not thread-safe.
class WalkSearches {
 public:
  /// `shelves`: as the plan says; false: none.
  WalkSearches(const CorrectionPlan& plan, bool exact, bool shelves = true);

  struct Search {
    Search(const ContinuousPlan& plan, bool shelves) : edges(plan, shelves), levels(edges) {}
    Edges edges;
    LevelSearch levels;
  };
  Search& of(std::size_t index);
  const MirroredPlans& plans() const { return *plans_; }
  const CureModel& model() const { return plan_.model; }
  const CorrectionPlan& plan() const { return plan_; }

 private:
  const CorrectionPlan& plan_;
  bool shelves_;
  std::shared_ptr<const MirroredPlans> plans_;
  std::vector<std::unique_ptr<Search>> searches_;
};

/// What a search is asked of slice n: where it stands, and in its own terms the dose at the slice's lower
/// node and what is taken from slices (LevelSearch::choose).
struct WalkAsk {
  RunAt run;
  std::size_t search;
  double below;
  const double* taken;
};

/// Features as bright as edges leave.
struct BrightLevels {
  /// Whether `look` is to see every slice, also those whose levels were chosen before.
  static constexpr bool kLooks = false;
  void look(int /*n*/, const WalkAsk& /*ask*/) {}
  int choose(int n, const WalkAsk& ask, LevelSearch& search, std::uint8_t* levels) {
    return search.choose(ask.run, n, ask.below, levels, ask.taken);
  }
};

/// One column: first its slices from the platform on, then the walk back.
class ColumnWalk {
 public:
  /// The next run of what is covered.
  void add(const CoverageRun& covered);
  /// The next slice that is left alone. `light`: its phi, for what it counts.
  void add_left_alone(const CureModel& model, int slice, double light);
  /// The run that was added last, of those that are left; there must be one.
  const ColumnRun& last() const { return runs_.back(); }
  /// Whether what lies above the last run asks nothing: the platform, or what is left alone.
  bool free_above() const { return runs_.size() < 2 || runs_[runs_.size() - 2].left_alone; }
  /// The upper edge of the last run, as the search `index` has it.
  std::int32_t edge_of(WalkSearches& all, std::size_t index);
  /// After the last slice.
  void begin(int slices) { lower_ = slices; }

  /// The level of slice n, by index of ContinuousPlan::levels; slices from the last on. `far(k)`: phi,
  /// for what it counts, of the slice that leaves the bath when slice k is shown; 0: none. Not for slices that are left
  /// alone.
  template <typename Far>
  int choose(WalkSearches& all, int n, Far far) {
    BrightLevels bright;
    return choose(all, n, far, bright);
  }
  /// The same by what `chooser` chooses, see BrightLevels.
  template <typename Far, typename Chooser>
  int choose(WalkSearches& all, int n, Far far, Chooser& chooser);
  /// The same with every intensity between black and full.
  template <typename Far>
  double exact(WalkSearches& all, int n, Far far);
  /// Whether slice n is left alone; to be asked before it is passed.
  bool left_alone(int n) { return run_at(n).left_alone; }
  /// Takes the light of a slice, for what it counts (`CureModel::ratio`).
  void pass(const CureModel& model, int slice, double light, double far) {
    omega_ =
        model.step_in(slice, model.bath_slices > 0 ? model.in_bath(light, far) : light, omega_);
  }

 private:
  const ColumnRun& run_at(int n) {
    while (runs_.back().node > n) {
      lower_ = runs_.back().node;
      after_ = before_;
      before_ = runs_.back();
      runs_.pop_back();
      passed_ = passed_ < 2 ? passed_ + 1 : 2;
      known_ = -1;
    }
    return runs_.back();
  }
  /// The last run of those that are left, as the search `index` has it.
  RunAt run_for(WalkSearches& all, std::size_t index);
  /// The search of slice n, of that run.
  static std::size_t search_of(const WalkSearches& all, const ColumnRun& run, int n) {
    const bool grey = run.cover != 0 && run.cover != kFull;
    return all.plans().at(grey ? n : run.node);
  }
  /// The level nearest to `level` with which the layer of slice n, of a feature, prints and keeps its
  /// cap. `near`: levels are chosen for the edge that comes, and only the cap is seen to.
  int seen_to(const WalkSearches& all, const RunAt& run, int n, double far, int level,
              bool near) const;

  std::vector<ColumnRun> runs_;  ///< those that are not passed
  ColumnRun before_, after_;     ///< the run that was passed last, and the one before it
  int passed_ = 0;               ///< how many of these there are
  int lower_ = 0;                ///< node of the lower end of the last run that is left
  std::int32_t known_ = -1;      ///< the search for which `run_` holds
  RunAt run_;
  std::uint8_t levels_[LevelSearch::kMost] =
      {};                     ///< that are chosen, the next of them `left_` before
  int left_ = 0, count_ = 0;  ///< the end
  double omega_ = 0;
};

template <typename Far, typename Chooser>
int ColumnWalk::choose(WalkSearches& all, int n, Far far, Chooser& chooser) {
  const ColumnRun& here = run_at(n);
  if (left_ > 0 && !Chooser::kLooks) return levels_[count_ - left_--];
  const std::size_t index = search_of(all, here, n);
  const RunAt run = run_for(all, index);
  WalkSearches::Search& search = all.of(index);
  const ContinuousPlan& p = search.edges.plan();
  const CureModel& model = all.model();
  const double factor = all.plans().factors[index];
  const int ahead = n - run.node + 1;
  // Each run has a factor of its own.
  const int slices = index == 0 ? LevelSearch::kMost : ahead;
  const int bath = model.bath_slices;
  double taken[LevelSearch::kMost];
  if (bath > 0) {
    const int known = search.levels.looks_ahead(run, n) ? std::min({bath, n + 1, slices}) : 1;
    for (int i = 0; i < LevelSearch::kMost; ++i) {
      taken[i] = i < known ? factor * model.beyond * far(n - i) : 0.0;
    }
  }
  const WalkAsk ask{run, index, factor * omega_, bath > 0 ? taken : nullptr};
  chooser.look(n, ask);
  if (left_ > 0) return levels_[count_ - left_--];
  count_ = chooser.choose(n, ask, search.levels, levels_);
  count_ = std::min({count_, slices, bath > 0 ? bath : LevelSearch::kMost});
  // Beside what is left alone a feature has no edge at which a search sees to its cap.
  const bool beside = runs_.size() > 1 && runs_[runs_.size() - 2].left_alone;
  if (index > 0 || (beside && ahead <= p.together)) {
    const bool near = ahead <= p.together;
    const auto seen = static_cast<std::uint8_t>(seen_to(all, run, n, far(n), levels_[0], near));
    // What comes after it is chosen anew, so that the cap is seen to there, too.
    if (near && all.plan().process.omega_max < kNoCap) count_ = 1;
    levels_[0] = seen;
  }
  left_ = count_ - 1;
  return levels_[0];
}

template <typename Far>
double ColumnWalk::exact(WalkSearches& all, int n, Far far) {
  const std::size_t index = search_of(all, run_at(n), n);
  const RunAt run = run_for(all, index);
  WalkSearches::Search& search = all.of(index);
  const ContinuousPlan& p = search.edges.plan();
  const CureModel& model = all.model();
  const double factor = all.plans().factors[index];
  double below = omega_;
  if (model.bath_slices > 0) below -= model.beyond * far(n) * p.b * p.per_a;
  if (index > 0) below *= factor;
  return search.levels.exact(run, n, below) / factor;
}

}  // namespace slicecorr::detail
