// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// The levels that columns get where light is even over the flow (`Process::even_light`), from the runs
/// of a column in one pass: what the rule (inhibited_rule.hpp) comes to, and tried before it.
///
/// A feature gets even light from its edge towards the platform on as soon as that edge bears it: the
/// light that this edge gets from all slices after is at most what it demands. Nearer to the edge the
/// column is dark, for one slice grey. Beyond the feature's end light goes on until the end has its
/// dose. Grey layers get the light that holds as much dose as they are covered.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "correct/inhibited_design.hpp"
#include "correct/inhibited_plan.hpp"

namespace slicecorr::detail {

/// Keeps its buffers. For one thread.
class EvenColumn {
 public:
  explicit EvenColumn(const InhibitedPlan& plan);
  /// `runs`: what is covered, first layer first; `even`: even levels of the column, per slice. Returns
  /// the levels of all slices; valid until the next call.
  const std::vector<Level>& levels(const std::vector<CoverageRun>& runs,
                                   const std::vector<Level>& even);
  /// The same once more, where the edge at a node is to get so much more dose than before.
  const std::vector<Level>& levels_again(const std::vector<CoverageRun>& runs);
  double& more_at(int node) { return more_[static_cast<std::size_t>(node)]; }

 private:
  using Run = std::vector<CoverageRun>::const_iterator;
  /// An edge towards the platform, and what it bears.
  struct Edge {
    int node = 0;
    double limit = 1;
  };
  void light_feature(Run first, Run past);
  Edge edge_of(Run first, Run past) const;
  int light_after(int end, double need);
  double one(int n, int level, int distance) const;
  double fade(int from, int to) const;
  int least_level(int n, int distance, double need) const;
  int even_at(int n) const { return plan_.cap_of(n, *even_); }

  const InhibitedPlan& plan_;
  int far_ = 0;                    ///< slices within which light of an edge is summed one by one
  std::vector<double> powers_;     ///< of a
  std::vector<double> more_;       ///< dose that edges are to get besides, by node
  std::array<Level, 256> grey_{};  ///< by coverage
  const std::vector<Level>* even_ = nullptr;
  std::vector<Level> levels_;
  int later_node_ = 0;     ///< edge of the feature after
  double later_dose_ = 0;  ///< that it has
};

}  // namespace slicecorr::detail
