// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Where the edges of a column are put so that its features and gaps hold although inputs are off.
///
/// `AimSearch` lets what fails push the edges beside it: those of a feature that is lost aim at more dose,
/// those of a gap that fills at less. Where pushing gains no more by finer steps either, not all can hold so:
/// the light of the column is planned (light_plan.hpp), or, where it can't be, what can't hold beside the rest
/// is given up, which is still to print with inputs as said.
#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>
#include <tuple>
#include <utility>
#include <vector>

#include "slicecorr/cure.hpp"

namespace slicecorr::detail {

enum class CoverKind : std::uint8_t { gap, run, grey };
inline CoverKind cover_kind(std::uint8_t coverage) {
  return coverage == 0 ? CoverKind::gap : coverage == 255 ? CoverKind::run : CoverKind::grey;
}

/// A feature that is lost in the weak case, or a gap that fills in the strong one: the layers
/// between two nodes.
struct RobustTrouble {
  std::size_t column;
  bool gap;
  int top, bottom;
  double miss = 0;       ///< by how much, of the logarithm of its dose
  bool nominal = false;  ///< it fails with inputs as said, too

  bool same_place(const RobustTrouble& o) const { return top == o.top && bottom == o.bottom; }
};

/// Where the coverage of a column changes, or may not.
struct MovedEdge {
  int node = 0;             ///< of the design
  std::uint8_t height = 0;  ///< its edge height there; 0: none
  bool movable = false;     ///< between a full layer and an empty one
  bool upper = false;       ///< the full layer is the one below
  std::uint8_t below = 0;   ///< coverage below it; of greys that of the design counts
  int aim = 0;              ///< dose to aim at, less 1, in steps
  int at_node = 0;          ///< where it is put
  std::uint8_t at_height = 0;

  /// Where it lies in the design, slices from the platform.
  double place() const;
  bool moved() const { return aim != 0; }
};
/// Those of a column, from the platform on; the first is at node 0.
using MovedEdges = std::vector<MovedEdge>;

/// Moves edges for what they aim at. An edge that aims at the dose D is the same as one that lies where
/// the dose is 1 when it is D there.
class EdgeMover {
 public:
  explicit EdgeMover(const CureModel& model) : model_(model), most_(most_aim(model)) {}
  /// Greatest dose that an edge may aim at.
  static double most_aim(const CureModel& model);
  /// Tries another aim of an edge, at most the greatest; false: there is no room for it.
  bool aim(MovedEdges& column, std::size_t k, int steps) const;

 private:
  void put(MovedEdge& edge) const;
  const CureModel& model_;
  const double most_;
};

/// How well a column holds. What fails with inputs as said counts first, then what fails in a case, then by how
/// much.
struct RobustScore {
  std::size_t as_said = std::numeric_limits<std::size_t>::max(), cases = 0;
  double miss = 0;
  explicit RobustScore() = default;
  explicit RobustScore(const std::vector<RobustTrouble>& troubles);
  /// The first two of these.
  std::pair<std::size_t, std::size_t> count() const { return {as_said, cases}; }
  bool operator<(const RobustScore& o) const {
    return std::tie(as_said, cases, miss) < std::tie(o.as_said, o.cases, o.miss);
  }
};

/// Looks for the edges of one column.
class AimSearch {
 public:
  /// `gives_up`: what can't hold beside the rest. `mover` must outlive this.
  AimSearch(const EdgeMover& mover, bool gives_up, MovedEdges column);
  const MovedEdges& tried() const { return now_; }
  const MovedEdges& best() const { return best_; }
  /// What fails in the best.
  const std::vector<RobustTrouble>& troubles() const { return failing_; }
  /// Takes what fails in the column that was tried; false: nothing more is to be tried.
  bool go_on(const std::vector<RobustTrouble>& troubles);

 private:
  bool given_up(const RobustTrouble& t) const;
  bool give_way();
  bool push(const std::vector<RobustTrouble>& troubles);

  const EdgeMover* mover_;
  bool gives_up_;
  MovedEdges now_, best_;
  std::vector<RobustTrouble> failing_, given_up_;
  RobustScore least_;
  int passes_ = 0, stride_, patience_;
};

}  // namespace slicecorr::detail
