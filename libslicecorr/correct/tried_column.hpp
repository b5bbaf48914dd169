// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Correction of pixel columns of any law of dose, by trying levels: resins with a time to gel
/// (docs/gel-time.md), resins that bleach (docs/bleaching.md).
///
/// The dose need be no sum over slices, but brighter light of a slice never makes it less, and the slices
/// after it are known when a slice is solved. So levels are found by trying them, from the last slice
/// on, each with the doses that it really gives:
///
/// - In a feature a slice gets the least level with which its layer's middle and its upper node gel.
/// - Before a feature, in the gap below it, a slice stays black as long as full light from the next one on
///   still brings the feature's lower edge where it belongs; else it gets the least level that does:
///   the burst.
/// - At a feature's upper edge it is the least level with which the edge does not lie inside the feature,
///   and then the levels of slices before it are moved by a few to put it where it belongs.
/// - Layer by layer each slice has only its own layer to gel; where the platform lifts, by its own exposure.
#pragma once

#include <memory>
#include <vector>

#include "correct/column_solver.hpp"
#include "correct/solved_columns.hpp"
#include "slicecorr/correct.hpp"

namespace slicecorr::detail {

/// What all columns share. Immutable; may be shared between threads.
struct TriedPlan {
  /// `model`: its law must be tried.
  TriedPlan(const CureModel& model, const Process& process, int target_layers, int all_slices);

  ColumnFacts facts() const;

  CureModel model;
  bool layerwise;
  int layers, all_layers;
  int highest = 0;       ///< lowest level of the brightest light
  int burst = 0;         ///< slices before a feature that can matter to its lower edge
  int together = 0;      ///< slices before an upper edge whose levels are moved to place it
  double shortfall = 0;  ///< of edges above gaps of one slice, slices
  double edge_dose = 0;  ///< an edge whose dose is this near to 1 is right
  /// Light may be off by about a per cent, as where it spreads: features get so much more, and edges lie
  /// so near to their nodes that voxels beside them stay right.
  bool careful = false;
  double margin() const;
  double farthest() const;  ///< that edges are aimed at from their nodes, slices
  std::shared_ptr<SolvedColumns> solved = std::make_shared<SolvedColumns>();
};

/// The solver of the plan's law.
std::unique_ptr<ColumnSolver> make_tried_column(const TriedPlan& plan);

}  // namespace slicecorr::detail
