// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// How far a column under inhibiting UV light is from its design.
#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

#include "correct/inhibited_design.hpp"
#include "correct/inhibited_doses.hpp"
#include "cure/inhibited_layer.hpp"
#include "slicecorr/dose.hpp"

namespace slicecorr::detail {

/// Judges the levels of a column. For one thread.
class ColumnJudge {
 public:
  ColumnJudge(const InhibitedPlan& plan, const ColumnDesign& design, const ColumnDoses& doses)
      : plan_(plan),
        design_(design),
        doses_(doses),
        layer_(*plan.kernel, false),
        floor_(*plan.kernel) {
    if (plan.uniform && plan.near <= static_cast<int>(sizeof(Window::levels))) safe_.resize(kSafe);
  }

  struct Score {
    double um = 0;        ///< the sum of what is wrong, see InhibitedTuning
    bool perfect = true;  ///< all edges and voxels are right
    int wrong_voxels = 0;
  };
  /// The score of the present levels. Where it would not be below `most_um`, `um` is infinite and
  /// dips() means nothing.
  Score score(double most_um);
  /// Where a feature comes apart: the layer in which its dose is least between two printed pieces.
  struct Dip {
    int layer;
    double least;
  };
  /// The dips that the last score() found.
  const std::vector<Dip>& dips() const { return dips_; }

 private:
  void count_wrong_voxels(Score& s) const;
  /// The levels of the slices that the tables know at a layer, and the least dose from beyond them with
  /// which it was found to gel all through: more can't part it.
  struct Window {
    std::uint64_t levels[2] = {};
    double beyond = std::numeric_limits<double>::infinity();
  };
  static constexpr std::size_t kSafe = 4096;
  Window& window_of(int k, Window& wanted);
  double edge_error_um(const ColumnDesign::Edge& edge) const;
  /// Adds what dips cost, until the score is `most_um`; then looks no further.
  void look_through(Score& s, double most_um);
  void look_through_feature(int& layer);
  void look_inside(int k);
  bool all_above_1(int k, double lower);
  void keep_what_stays();

  const InhibitedPlan& plan_;
  const ColumnDesign& design_;
  const ColumnDoses& doses_;
  InhibitedLayer layer_;
  LayerFloor floor_;
  InsideLayer inside_;
  std::vector<Dip> dips_;
  std::vector<Window> safe_;  ///< by a hash of the levels; empty: not kept
  /// Of levels that were judged: by layer the light from beyond its near slices with which it was found to be above 1;
  /// infinite where it was not, or where a near slice has changed since. Only while `floor_` exists.
  std::vector<std::uint8_t> judged_;
  std::vector<double> above_with_;
  // Slices run_first_ .. run_end_ - 1 show one level.
  int run_first_ = -1, run_end_ = 0;
};

}  // namespace slicecorr::detail
