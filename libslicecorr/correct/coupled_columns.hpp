// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// The coupled correction where doses are no sums of light: under UV light, of resins with a time to gel
/// and of those that bleach.
///
/// There no light can be chosen slice by slice for the dose. But what a column needs is known: the solve
/// of a single column (column_solver.hpp) says which light is to reach it, slice by slice. So each column
/// *wants* its light, and the pixels of each slice are chosen in the plane so that their light, spread,
/// is what the columns want: Gauss and Seidel's y + (wanted - G y) / G(0), pixel after pixel, held between
/// black and full light. That is the least light that does: where a pixel shines, its column gets
/// what it wants.
///
/// At edges and corners full light is less than what a column alone counts on, and neighbours shine
/// into slices in which a column wants to be dark. Columns whose voxels are wrong are solved again
/// with these bounds, and want that then.
///
/// Files: this one; `coupled_columns_wanted` solves columns again, `coupled_columns_plane` chooses the
/// pixels of a patch, `coupled_columns_judge` judges them.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <vector>

#include "correct/column_solver.hpp"
#include "correct/inhibited_plan.hpp"
#include "correct/tried_column.hpp"
#include "slicecorr/correct.hpp"

namespace slicecorr::detail {

/// Whether columns of a model can be corrected together under UV light: not where UV light is
/// patterned, as its pattern follows grey levels and not the light that columns get, and not where
/// light is made for an even dead zone.
bool can_couple_under_uv(const CureModel& model);

/// Whether columns say which light they want: where doses are no sums of light.
bool want_their_light(const CureModel& model);

/// Slices after the last layer of a part in which its straight edges cure, which get half the light;
/// where that does not do, those of an absorbance height.
int slices_to_gel_at_edges_by_columns(const CureModel& model);

/// Plans of single columns under UV light with edges that light which is off by some per cent does not move past
/// a voxel's middle. Thread-safe.
class CarefulPlans {
 public:
  /// `columns` must outlive this.
  const InhibitedPlan& of(const CorrectionPlan& columns, double most_dose);

 private:
  std::mutex making_;
  std::map<const CorrectionPlan*, std::unique_ptr<const InhibitedPlan>> made_;
};

/// What all patches share where columns want their light. Immutable.
struct CoupledColumns {
  /// `most_dose`: the greatest dose that is wanted; 1: none is. `most_uv`: of the plan's UV light the most
  /// that a pixel gets.
  explicit CoupledColumns(const CorrectionPlan& columns, double most_dose = 1, double most_uv = 1);

  /// The level whose light is nearest.
  int level_of(double its_light) const;
  double full() const { return light.back(); }
  /// The highest level of a slice.
  int cap_of(int slice) const { return inhibited ? inhibited->cap_of(slice) : tried->highest; }
  /// Solves columns with wrong voxels.
  std::unique_ptr<ColumnSolver> solver() const;

  ColumnFacts facts;
  /// Edges of columns with wrong voxels are aimed nearer to their nodes, where light that is off by some
  /// per cent does not turn the voxel beside them. One of them, as the law is.
  std::optional<InhibitedPlan> inhibited;
  std::optional<TriedPlan> tried;
  CureModel judged;  ///< under UV light its kernel is by fronts
  std::vector<double>
      light;  ///< of each grey level, in what adds up: intensities, or shares of them
};

}  // namespace slicecorr::detail
