// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Correction of pixel columns of resins with a time to gel (docs/gel-time.md).
///
/// The dose is no sum over slices, but brighter light of a slice never makes it less, and the slices
/// after it are known when a slice is solved. So levels are found by trying them, from the last slice
/// on, each with the doses that it really gives:
///
/// - In a feature a slice gets the least level with which its layer's middle and its upper node gel.
/// - Before a feature, in the gap below it, a slice stays black as long as full light from the next one on
///   still brings the feature's lower edge where it belongs; else it gets the least level that does:
///   the burst.
/// - At a feature's upper edge it is the least level with which the edge does not lie inside the feature,
///   and then the levels of slices before it are moved by a few to put it where it belongs.
/// - Layer by layer each slice has only its own layer to gel.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "correct/column_solver.hpp"
#include "cure/gel_time_cut.hpp"
#include "slicecorr/correct.hpp"

namespace slicecorr::detail {

/// What all columns share. Immutable; may be shared between threads.
struct GelTimePlan {
  GelTimePlan(const CureModel& model, const Process& process, int target_layers, int all_slices);

  ColumnFacts facts() const;
  const CutLight light(int slice, int level) const {
    const CutLight& l = kernel->light(level);
    if (ratio.empty()) return l;
    const double r = ratio[static_cast<std::size_t>(slice)];
    return {r * l.x, r * l.y};
  }

  std::shared_ptr<const GelTimeKernel> kernel;
  GelTimeCut cut;
  std::vector<double> ratio;  ///< exposure of each slice over the normal one; empty: all 1
  int layers, all_layers;
  int highest = 0;       ///< lowest level of the brightest light
  int burst = 0;         ///< slices before a feature that can matter to its lower edge
  int together = 0;      ///< slices before an upper edge whose levels are moved to place it
  double step = 0;       ///< greatest step of the dose between two levels in a layer
  double shortfall = 0;  ///< of edges above gaps of one slice, slices
  double edge_dose = 0;  ///< an edge whose dose is this near to 1 is right
};

class GelTimeColumn final : public ColumnSolver {
 public:
  explicit GelTimeColumn(const GelTimePlan& plan);
  const std::vector<Level>& solve(const std::vector<CoverageRun>& runs,
                                  const ColumnBounds& bounds) override;

 private:
  /// A place that is to have at least `dose`, the distance from the lower node of its layer in slices.
  struct Ask {
    int layer;
    double up, dose;
  };
  /// What lies below a layer.
  struct Below {
    const GelTimeColumn& column;
    int layer;
    int count() const { return column.plan_.all_layers - layer; }
    const CutLight& at(int j) const {
      return column.state_[static_cast<std::size_t>(layer + 1 + j)];
    }
    double x(int j) const { return at(j).x; }
    double y(int j) const { return at(j).y; }
    const CutLight& light(int j) const {
      return column.light_[static_cast<std::size_t>(layer + 1 + j)];
    }
  };

  void read(const std::vector<CoverageRun>& runs);
  int cover(int n) const {
    return n >= 0 && n < plan_.layers ? cover_[static_cast<std::size_t>(n)] : 0;
  }
  /// How far below its node an edge belongs, slices, no further than levels can bring it.
  double edge_below(int node) const { return below_[static_cast<std::size_t>(node)]; }
  /// What the layers above slice n ask of it: those of the next feature, and of greys before it.
  void find_asks(int n);

  void set(int n, int level);
  double dose(int layer, double up) const;
  double upper(int layer) const;
  double middle(int layer) const;
  /// The dose where the upper edge of the feature belongs that begins with layer n.
  double at_upper_edge(int n);

  int level_of(int n);
  int full_level(int n);
  int gap_level(int n);
  int grey_level(int n);
  int layerwise_level(int n);
  /// Whether full light from slice n - 1 on can still do what is asked.
  bool can_do(int n);
  /// Whether the present slice has its layer of a feature printed.
  bool prints(int n) const;
  bool edge_above(int n) const { return n > 0 && cover(n - 1) == 0; }
  /// The least level from `least` on for which `enough`, which holds for all brighter ones; the highest
  /// where none does. `guess`: where to look first. Leaves that level set.
  template <typename Enough>
  int least_level(int n, int least, int guess, Enough enough);
  /// The least level from `least` on with which the upper edge of layer n does not lie inside the
  /// feature: there the dose is flat, and a little less of it would move the edge far.
  int level_to_edge(int n, int least, int guess);
  /// How far above its lower end the layer of a feature must print, slices; 0: where it begins.
  double lower_edge_up(int n) const;
  void place_edge(int n);

  const GelTimePlan& plan_;
  std::vector<Level> levels_;
  std::vector<std::uint8_t> cover_;
  std::vector<double> below_;
  std::vector<int> above_;  ///< per slice: the last layer up to it that is not empty; -1: none
  std::vector<CutLight> state_, light_;
  std::vector<Ask> asks_;
  int before_ = 0;  ///< level of the slice that was solved last
  mutable int hint_ = 0;
};

}  // namespace slicecorr::detail
