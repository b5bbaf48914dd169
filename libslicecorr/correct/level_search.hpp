// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Levels that print edges where they belong; docs/levels.md explains the method.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <deque>
#include <vector>

#include "correct/edges.hpp"
#include "slicecorr/dose_target.hpp"

namespace slicecorr::detail {

/// Where a column's walk from the last slice to the first stands: the run in which the present
/// slice lies, and what lies below that run.
struct RunAt {
  std::int32_t edge = 0;    ///< its upper end, in Edges; its coverage is that edge's `below`
  std::int32_t node = 0;    ///< node of its upper end
  std::int32_t lower = 0;   ///< node of its lower end
  std::uint8_t below = 0;   ///< coverage below its lower end
  bool slit_below = false;  ///< below it lies a gap of one slice between full layers
  std::uint8_t lower_height = kEdgeAtNode;  ///< edge height of its lower end

  /// Whether the edge at its lower end lies inside its last slice.
  bool ends_inside() const { return lower_height < kEdgeAtNode; }
};

/// The run above, with `node` as its lower end.
RunAt run_above(const Edges& edges, const RunAt& run);

/// Levels of one column after the other, by index of ContinuousPlan::levels. Not thread-safe.
class LevelSearch {
 public:
  explicit LevelSearch(const Edges& edges);

  /// Most slices that are chosen at once.
  static constexpr int kMost = 64;
  /// Writes the levels of slice n and of those after it (n - 1, ...) that were chosen with it;
  /// returns how many. `below`: Omega(n + 1) as delivered. `taken`: of `kMost` slices from n on, what is
  /// taken from their phi because it leaves the bath; only that of slice n where the search has not
  /// come to an edge (`looks_ahead`). Null: nothing.
  int choose(const RunAt& run, int n, double below, std::uint8_t* levels,
             const double* taken = nullptr);
  /// Whether slice n is chosen together with slices after it.
  bool looks_ahead(const RunAt& run, int n) const {
    return n - run.node < plan_.together && is_edge(run.edge);
  }
  /// As choose(), near to the light `phi` in features: `side` says on which side of it a level may
  /// be, where one fits. Doses of features stay at or below `most`, by node, and by `room` at most
  /// above it, before edges as far as these stay right. `phi`: what a slice counts for before anything is
  /// taken from it.
  struct Wanted {
    double phi;
    DoseSide side;
    const double* most;
    double room;
  };
  int choose_near(const RunAt& run, int n, double below, const Wanted& wanted, std::uint8_t* levels,
                  const double* taken = nullptr);
  /// The phi of slice n when every intensity may be shown.
  double exact(const RunAt& run, int n, double below) const;

 private:
  struct Light {
    double least, most;
  };
  /// Bounds of the light that a layer allows, given the dose w at its lower node: on one side
  /// `own.at - own.per w`, on the other the narrowest of four of that form.
  struct Bound {
    double at, per;
  };
  struct LightRule {
    bool feature;
    Bound own;
    std::array<Bound, 4> others;
    int opposites = 0;  ///< where edges lie inside the layer: more bounds on the side of `own`
    std::array<Bound, 2> opposite;
    Light at(double w) const {
      double one = own.at - own.per * w;
      for (int k = 0; k < opposites; ++k) {
        const Bound& b = opposite[static_cast<std::size_t>(k)];
        one = feature ? std::min(one, b.at - b.per * w) : std::max(one, b.at - b.per * w);
      }
      const auto other = [&](std::size_t k) { return others[k].at - others[k].per * w; };
      if (feature) {
        return {std::max(std::max(other(0), other(1)), std::max(other(2), other(3))), one};
      }
      return {one, std::min(std::min(other(0), other(1)), std::min(other(2), other(3)))};
    }
  };
  /// What levels of a slice are chosen by.
  struct LevelStep {
    LightRule light;
    double ratio = 1;  ///< what the slice counts for over a normal one
    const LayerFactors* layer = nullptr;
    std::int32_t edge;
    int j;  ///< nodes below that edge
    std::uint8_t coverage;
    bool slit;
  };
  /// One of the slices that are chosen together.
  struct SearchStep : LevelStep {
    bool upper, lower, slit_below;
    std::uint8_t upper_height, lower_height;
    LayerRule rule;
    DoseRange target;  ///< of its upper node
  };
  struct LevelRange {
    int first, last;
    bool empty() const { return first > last; }
  };
  struct Survivor {
    double dose;
    std::int32_t before;
    std::uint8_t level;
  };

  LightRule light_rule(const LayerFactors& layer, const LayerRule& rule, DoseRange target) const;
  /// Levels of a slice that counts for `ratio`, with `taken` from its phi.
  LevelRange levels(const LightRule& rule, double below, double ratio, double taken = 0.0) const;
  /// Whether levels() finds any.
  bool any_level(const LightRule& rule, double below, double ratio, double taken) const;
  /// The phi between which levels are looked for.
  Light of_levels(const LightRule& rule, double below, double ratio, double taken) const {
    Light l = rule.at(below);
    l.least += taken;
    l.most += taken;
    if (ratio != 1.0) {
      l.least /= ratio;
      l.most /= ratio;
    }
    return l;
  }
  /// Dose after the gathered slice `k` shows `level`.
  double after(const LevelStep& step, int k, int level, double below) const {
    return step.layer->step(step.ratio * plan_.levels.phi(level) - taken_at(k), below);
  }
  /// What is taken from slice `k` of those that are chosen together.
  double taken_at(int k) const { return taken_ ? taken_[k] : 0.0; }
  LayerRule rule_of(const RunAt& run, int n, int rung) const;
  int one_slice(const RunAt& run, int n, double below) const;
  int one_slice_near(const RunAt& run, int n, double below, const Wanted& wanted) const;
  /// Finds levels of the gathered slices by which the first edges lie where they should and no
  /// feature passes `most` and `room`.
  bool search_below(double below, const Wanted& wanted, double room, std::uint8_t* levels);
  double grey_aim(const RunAt& run, int n, double below) const;
  /// Whether a feature and a gap meet at this edge.
  bool is_edge(std::int32_t id) const;
  /// Gathers the slices that are chosen together from n on; returns how many.
  int gather(const RunAt& start, int n);
  /// Sets rules and targets for edges within `tolerance`; false: no light meets them.
  bool aim(double tolerance);
  bool aim(const EdgeCorners& usual);
  /// Whether the upper node of a gathered slice lies inside a feature.
  bool inside_feature(const SearchStep& step) const;
  /// Keeps the dose of the gathered slice k below `most_`; false: it can't be.
  bool hold_below(SearchStep& step, int k) const;
  /// Finds levels of the gathered slices; false: no sequence of levels is right.
  bool search(double below, std::uint8_t* levels, std::size_t from);
  template <class AnyStep>
  bool depth_first(const AnyStep* steps, double below, std::uint8_t* out) const;
  bool survivors(double below, std::uint8_t* out);

  const Edges& edges_;
  const ContinuousPlan& plan_;
  const double* taken_ = nullptr;
  std::array<SearchStep, kMost> steps_;
  /// While a search is held below doses: by node, and how far above them it may go; null: none.
  const double* most_ = nullptr;
  double room_ = 0;
  int top_ = 0;  ///< the first of the gathered slices
  int count_ = 0;
  int first_edge_ = 0;  ///< slices up to the first edge
  bool cut_ = false;
  /// The steps of the usual case, at the tolerance aimed at: slices that begin `together` before an
  /// edge, with no other edge near. Null: it is not the usual case.
  const LevelStep* prepared(const RunAt& run, int n);
  static constexpr std::int32_t kNotYet = -1, kUnusual = -2;
  std::vector<std::int32_t> prepared_of_;        ///< by edge: where its steps are
  std::deque<std::vector<LevelStep>> prepared_;  ///< in pieces that stay where they are
  /// Levels that were found, by what they follow from.
  struct Known {
    static constexpr int kSlices = 8;
    std::uint64_t bits = 0;
    std::int32_t edge = -1, j = 0;
    std::uint8_t first = 0, height = kEdgeAtNode, count = 0;
    std::uint8_t levels[kSlices] = {};
  };
  std::array<Known, 4096> known_;
  std::vector<Survivor> kept_;
  std::vector<std::int32_t> begin_;
};

}  // namespace slicecorr::detail
