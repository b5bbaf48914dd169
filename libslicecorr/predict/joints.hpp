// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What holds when the platform lifts, layer by layer (docs/lifts.md): each exposure by itself, and
/// where edges lie if lifts exchange all of the resin, and if they exchange none.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "slicecorr/cure.hpp"
#include "slicecorr/predict.hpp"

namespace slicecorr::detail {

/// Follows the columns of a band from the last slice to the first. Not thread-safe.
class JointWalker {
 public:
  /// `model`: with lifts; outlives it.
  JointWalker(const CureModel& model, std::size_t columns);

  /// phi of each column for what the slice counts (`CureModel::ratio`), and the coverage and edge
  /// heights of its layer; `heights` null: none.
  void add_slice(int slice, const double* phi, const std::uint8_t* coverage,
                 const std::uint8_t* heights, bool at_heights);
  /// After the first slice. Adds what was found.
  void finish(JointFigures& figures);

 private:
  struct Column {
    /// Own exposures, at the window: of the lowest layer that nothing solid is known to lie above.
    double candidate = 0;
    std::int32_t liquid = 0;      ///< liquid layers right above it, up to the layer added last
    std::int32_t edge_node = -1;  ///< upper node of the feature below the present gap; -1: none
    double edge_um = 0;           ///< how far its edge reaches beyond, exchanged
    double staying_um = 0;        ///< the same where no resin is
    double beyond_um = 0;         ///< edge height: what of it belongs to the feature
    bool goes_on = false;         ///< it goes into the next layer of the gap, too, where none is
    bool full = false;            ///< the layer added last is of a feature
  };
  void join(double own_window, int slice);
  void end_feature(Column& c, int node);
  void begin_gap(Column& c, int node, double exchanged, std::uint8_t height);
  void begin_staying(Column& c, int node, double below, double above);
  void go_on(Column& c, int node, double above);
  double reach_um(double dose, int node) const;
  void end_gap(Column& c, int node);

  const CureModel& model_;
  std::vector<Column> columns_;
  /// The brightest exposure so far, at the window of the layer that comes next.
  std::vector<double> brightest_;
  std::vector<double> all_;            ///< all exposures so far, there
  std::vector<std::uint8_t> heights_;  ///< edge heights of the node between the layers
  JointFigures figures_;
};

}  // namespace slicecorr::detail
