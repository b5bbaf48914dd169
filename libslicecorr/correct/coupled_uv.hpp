// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// The coupled correction under UV light.
///
/// Under UV light doses of slices do not add up to those of their light, so no light can be chosen
/// slice by slice for the dose. But what a column needs is known: the solve of a single column
/// (inhibited_column.hpp) says which light is to reach it, slice by slice. So each column *wants* its
/// light, and the pixels of each slice are chosen in the plane so that their light, spread, is what
/// the columns want: Gauss and Seidel's y + (wanted - G y) / G(0), pixel after pixel, held between
/// black and full light. That is the least light that does: where a pixel shines, its column gets
/// what it wants.
///
/// At edges and corners full light is less than what a column alone counts on, and neighbours shine
/// into slices in which a column wants to be dark. Columns whose voxels are wrong are solved again
/// with these bounds, and want that then.
///
/// Files: this one; `coupled_uv_wanted` solves columns again, `coupled_uv_plane` chooses the pixels
/// of a patch, `coupled_uv_judge` judges them.
#pragma once

#include <cstdint>
#include <vector>

#include "correct/inhibited_plan.hpp"
#include "slicecorr/correct.hpp"

namespace slicecorr::detail {

/// Whether columns of a model can be corrected together under UV light: not where UV light is
/// patterned, as its pattern follows grey levels and not the light that columns get, and not where
/// light is made for an even dead zone.
bool can_couple_under_uv(const CureModel& model);

/// Slices after the last layer of a part in which its straight edges cure, which get half the light;
/// where that does not do, those of an absorbance height.
int slices_to_gel_at_edges_under_uv(const CureModel& model);

/// What all patches share under UV light. Immutable.
struct CoupledUv {
  explicit CoupledUv(const CorrectionPlan& columns);

  /// The level whose light is nearest.
  int level_of(double blue_mw_cm2) const;
  double full() const { return blue.back(); }

  const InhibitedPlan& plan;
  /// Of columns with wrong voxels: edges are aimed nearer to their nodes, where light that is off by
  /// some per cent does not turn the voxel beside them.
  InhibitedPlan careful;
  CureModel by_front;        ///< its kernel is by fronts
  std::vector<double> blue;  ///< of each grey level, mW/cm²
};

}  // namespace slicecorr::detail
