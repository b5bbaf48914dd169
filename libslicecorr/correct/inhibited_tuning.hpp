// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// The numbers of the correction under UV light that were chosen by trial, each with its reason.
///
/// docs/inhibition.md ("The numbers of the rule") tells what happens when each is halved and
/// doubled; tests/bench/inhibited_tuning.cpp measures it. Doses are relative: 1 gels the resin.
/// Numbers "in layers" are errors in heights of a layer, so that they weigh alike at any height.
#pragma once

#include <array>
#include <cstddef>

#include "correct/solved_columns.hpp"

namespace slicecorr::detail {

struct InhibitedTuning {
  // What a column demands of its nodes.

  /// Dose at nodes inside features; layer by layer times what the steady dose ripples. Between two
  /// nodes the dose may dip while the light settles; a reserve of 0.3 % holds that in columns of
  /// ordinary height, and where it does not, looking through the features finds it. Every reserve
  /// is light that reaches into the gaps, too.
  double inside_dose = 1.003;
  /// Dose at the node between a gap of one layer and the feature above it. Light for the layers
  /// below passes the gap, so the edge above must give way; 2 % below gelation opens the gap
  /// without taking the last layer's middle.
  double slit_edge_dose = 0.98;
  /// Dose at the node one layer above that one. The dose falls from here to `slit_edge_dose`; with
  /// 3 % the middle between the two still gels.
  double slit_inner_dose = 1.03;

  // How levels are chosen for these demands.

  /// Lags to try, as shares of the distance at which the kernel has its peak, the likeliest first.
  /// Short lags keep gaps sharp, long ones suit thin features. Columns that are right with one try
  /// no other, so more of them cost time only in columns that are hard to draw. In continuous
  /// exposure light swings inside features with the longest lag at great speeds.
  struct Fraction {
    int times, over;
  };
  using LagShares = std::array<Fraction, 5>;
  LagShares lag_shares{{{1, 2}, {2, 3}, {1, 1}, {1, 3}, {1, 4}}};
  /// The same layer by layer, where the longest one suits nearly all columns.
  LagShares layerwise_lag_shares{{{1, 1}, {2, 3}, {1, 2}, {1, 3}, {1, 4}}};
  /// Lags in turn that bring nothing after which a column without a wrong voxel tries no other.
  int lags_in_vain = 2;
  /// The lag for which there are slices after the end of a part, as such a share.
  Fraction end_lag_share{1, 2};
  /// Slices by which the last slice that a node may ask for lies beyond reach and lag together,
  /// since both are rounded to whole slices.
  int spare_slices = 2;
  /// A level that has stood for so many lengths of the kernel's tables is taken over, without
  /// looking at nodes, until an edge comes near. After one length all near light is the same;
  /// another one lets the far light fade.
  int settled_lengths = 2;
  /// Inside features a level stays although up to so many levels less would do: otherwise levels go
  /// to and fro by a few, which prints the same and fills the archive.
  int calm_levels = 3;
  /// Most features of a column for which each is tried with each lag: the trials grow with the
  /// square of their number.
  std::size_t own_lag_features = 64;

  // Edges with heights: their nodes demand what brings the edges there.

  /// Most rounds for each lag.
  int aim_rounds = 2;
  /// Dose at an edge that may be lacking or too much: half a um at usual slopes.
  double aim_enough = 0.005;
  /// Least demand of the node of such an edge, so that its feature still asks for light.
  double aim_least = 0.3;

  /// Steps in a slice to which edge heights are rounded, so that neighbours on a slope are solved
  /// once: at slices of 50 um off by 0.8 um in the mean, less than levels leave.
  double height_steps = 16;

  // Which levels are kept: the error of a column is a sum over edges, voxels and pieces.

  /// Edges within this of their place are right: 1 um is far below a slice, and a column that is
  /// right saves the trials after it.
  double tolerance_um = 1;
  /// The same for edges beside their nodes, which levels can only come near to.
  double height_tolerance_um = 2;
  /// How far from its node an edge is aimed at most, in layers: where the design's own edge comes
  /// nearer to the middle of a layer, levels can't keep that middle on its side. Where a column has
  /// wrong voxels all the same, the next of these is tried; the last is that of edges at nodes.
  std::array<double, 3> farthest_edge_layers{0.43, 0.25, 0};
  /// What one edge counts at most, in layers, and how far it is looked for. What is further off
  /// shows as wrong voxels, which count by themselves.
  double most_edge_layers = 2;
  /// What a voxel that cured in a gap counts, in layers.
  double grown_voxel_layers = 2;
  /// What a voxel that did not cure counts, in layers: a lost feature is worse than one that grew.
  double lost_voxel_layers = 4;
  /// What a place where a feature comes apart counts, in layers: more than its edges and voxels
  /// around it together, since a part in pieces is lost.
  double split_layers = 16;
  /// What the depth of the dip counts in addition, in layers per unit of dose, so that of two
  /// cracked columns the one nearer to solid is kept; up to `most_split_depth_layers`.
  double split_depth_layers = 100;
  double most_split_depth_layers = 4;

  // Even light (even_column.hpp), tried before anything else where light is even over the flow.

  /// Most rounds in which edges get what they lack.
  int even_rounds = 3;
  /// Edges within this of their place are right there: one level of some 150 moves an edge by as
  /// much, and other tries would come no nearer, at ten times the time and with other light than was
  /// planned.
  double even_tolerance_um = 3;
  /// Dose that nodes of grey layers may lack.
  double even_grey_lacks = 0.05;

  // Features that come apart: the nodes around the dip demand more, round by round.

  /// Most rounds in which demands are raised.
  int raise_rounds = 10;
  /// Rounds in which only nodes inside the feature demand more. After them edges give way too: a
  /// solid feature comes before the place of its edges.
  int raise_rounds_inside = 3;
  /// What is demanded beyond the dose missing in the dip, so that rounding to levels can't undo it.
  double raise_extra_dose = 1e-3;
  /// By how many times the missing dose each round demands more than the round before. Where levels
  /// are few the next one is far, and the same step would never reach it.
  double raise_growth = 1;

  // Polishing: columns with wrong voxels descend on a sum of weighted squares of doses.

  /// Most passes over the column; it ends earlier when nothing moves any more. More passes still
  /// mend a little, for time in proportion.
  int polish_sweeps = 6;
  /// Steps of one slice's level, up and down: fine ones to settle, coarse ones to leave a valley.
  std::array<int, 5> polish_steps{1, 3, 8, 20, 60};
  /// Steps by which light moves between a slice and the one above it.
  std::array<int, 3> polish_moves{4, 15, 50};
  /// Cost around a slice below which it is left alone: an edge that is off by 0.1 % of the dose.
  double polish_enough = 1e-5;
  /// Least fall of the cost that counts, far above rounding.
  double polish_least_gain = 1e-9;
  /// Weight of the distance of an edge's dose from 1.
  double edge_weight = 10;
  /// Dose that the middles of full layers are to have, and the weight of what is missing: lost
  /// voxels weigh most.
  double core_dose = 1.004;
  double core_weight = 400;
  /// Dose from which on the middle of a full layer has too much, and its weight: little, as it does
  /// no harm by itself, but of two ways to cure a feature the one with less light is kept.
  double excess_dose = 1.15;
  double excess_weight = 0.02;
  /// Dose that the middles of gaps are to stay below, and the weight of what is above.
  double gap_dose = 0.99;
  double gap_weight = 100;
  /// Dose that all samples of a full layer are to have (layer by layer only), and the weight of
  /// what is missing: first a weight that leaves edges a say, then one that goes before anything.
  double dip_dose = 1.003;
  std::array<double, 2> dip_weights{4e3, 1e6};

  /// Where light is even, whether columns keep what was planned for it, with their edges brought to their
  /// places but nothing else mended: a look at what will be shown, in a fraction of the time.
  bool as_planned = false;

  // Memory.

  /// Bytes of solved columns that are kept for those that are alike, in all bands together. Changes
  /// the time, never the levels.
  std::size_t kept_bytes = SolvedColumns::kMostBytes;
};

}  // namespace slicecorr::detail
