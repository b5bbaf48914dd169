// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// One column problem, whatever the model and whatever is asked: a column goes to a solver whole, with
/// what it is to print (its runs; what no run covers is a gap) and with bounds of its doses and its light
/// (`ColumnBounds`); levels of all slices come back.
///
/// Solvers differ by how dose goes on from slice to slice:
///
/// - `WalkedColumn`: sums of light, continuous. Edges say exactly which doses lead on (level_search.hpp).
///   Columns of plain models that are asked no more than their runs have a fused loop besides
///   (continuous.cpp), which gives the same bits.
/// - `TriedColumn`: laws whose doses are no sums of light; levels are tried.
/// - `InhibitedColumn`: UV light, where a slice acts on several nodes above its own.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "slicecorr/dose_target.hpp"

namespace slicecorr::detail {

class SolvedColumns;

/// A grey level.
using Level = std::uint8_t;

/// Layers [first, end) of a column have this coverage, 1..255, between nodes of these edge heights.
struct CoverageRun {
  std::int32_t first = 0, end = 0;
  std::uint8_t coverage = 0;
  std::uint8_t upper_height = 0, lower_height = 0;
  bool operator==(const CoverageRun&) const = default;
};

/// Layers [first, end) of a column are left alone: their slices show this level, and nothing is asked of
/// them.
struct LeftAloneRun {
  std::int32_t first = 0, end = 0;
  Level level = 0;
  bool operator==(const LeftAloneRun&) const = default;
};

/// Bounds of the light of a column, per slice; empty: black, and the highest levels of the plan.
struct ColumnBounds {
  std::vector<Level> floors;  ///< what others shine into the column
  std::vector<Level> caps;    ///< not below the floors
  /// First layer first; floors and caps are their levels there. To what is left alone a feature has no
  /// edge.
  std::vector<LeftAloneRun> left_alone;
  /// Of each layer the dose that is wanted, 1 or more, in features; empty: just enough.
  std::vector<double> wanted;
  DoseSide side = DoseSide::nearest;
};

/// Chooses the levels of columns one by one; keeps its buffers. For one thread.
class ColumnSolver {
 public:
  virtual ~ColumnSolver() = default;
  /// `runs`: what is covered, first layer first. Returns the levels of all slices, within the
  /// bounds; valid until the next call.
  virtual const std::vector<Level>& solve(const std::vector<CoverageRun>& runs,
                                          const ColumnBounds& bounds) = 0;
};

/// What a band needs to know of a plan whose columns are solved so.
struct ColumnFacts {
  int layers = 0, all_layers = 0;
  bool lower_at_window = false;  ///< lower edges lie at the window: their heights count for nothing
  double height_steps = 1;       ///< edge heights are rounded to this part of a slice
  /// Columns that begin beyond layer `begin_at` and end `clear_after` slices and more before the last
  /// are solved as if they began there, so that those that differ in their height alone are solved
  /// once. 0: none are.
  int begin_at = 0, clear_after = 0;
  /// Solved ones that are kept for those that are alike; null: none are.
  std::shared_ptr<SolvedColumns> solved;
  int levels = 256;  ///< grey levels
  /// Where doses are wanted, 1 is one of them; else features of which no more than 1 is wanted are as
  /// where none is.
  bool wants_ones = false;
  /// Whether columns keep to caps of their light where nothing is left alone (`BandSolver::keep_light`).
  bool keeps_caps = true;
};

/// A solver, and what a band needs to know of it.
struct SolvedBy {
  std::unique_ptr<ColumnSolver> solver;
  ColumnFacts facts;
};

/// Calls `add(run)` for each run of a column from the platform on, those of gaps and of what is left
/// alone among them; `run.upper_height` is that of its first node, 0 where it has none.
template <typename Add>
void for_each_run(const std::vector<CoverageRun>& covered, const std::vector<LeftAloneRun>& left,
                  int slices, Add add) {
  auto run = covered.begin();
  auto alone = left.begin();
  std::uint8_t height = 0;  // of the node at which the run before ended
  for (std::int32_t n = 0; n < slices;) {
    if (alone != left.end() && alone->first == n) {
      add(CoverageRun{n, alone->end, 0, 0, 0}, &*alone);
      n = alone->end;
      height = 0;
      ++alone;
    } else if (run != covered.end() && run->first == n) {
      add(*run, nullptr);
      n = run->end;
      height = run->lower_height;
      ++run;
    } else {
      std::int32_t end = slices;
      if (run != covered.end()) end = std::min(end, run->first);
      if (alone != left.end()) end = std::min(end, alone->first);
      add(CoverageRun{n, end, 0, height, 0}, nullptr);
      n = end;
      height = 0;
    }
  }
}

/// Moves the runs of a column to where it is solved; returns by how many layers.
int move_to_begin(const ColumnFacts& facts, std::vector<CoverageRun>& runs);

/// The edge height of a run's end as the solve takes it: rounded, so that neighbours on a slope are
/// alike and are solved once; none at the node where it is so near that rounding makes it 0.
std::uint8_t taken_height(const ColumnFacts& facts, std::uint8_t height);

/// The runs of one column of `coverage` by layers, with edge heights by nodes.
std::vector<CoverageRun> runs_of(const ColumnFacts& facts,
                                 const std::vector<std::uint8_t>& coverage,
                                 const std::vector<std::uint8_t>& heights);

/// The levels of such a column.
std::vector<std::uint8_t> solve_alone(ColumnSolver& solver, const ColumnFacts& facts,
                                      const std::vector<std::uint8_t>& coverage,
                                      const std::vector<std::uint8_t>& heights);

}  // namespace slicecorr::detail
