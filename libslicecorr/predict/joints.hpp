// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What holds when the platform lifts, layer by layer (docs/lifts.md): each exposure by itself, and
/// where edges lie if lifts exchange all of the resin, and if they exchange none.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <vector>

#include "cure/own_doses.hpp"
#include "slicecorr/cure.hpp"
#include "slicecorr/dose.hpp"
#include "slicecorr/predict.hpp"

namespace slicecorr::detail {

/// Follows the columns of a band from the last slice to the first. Not thread-safe.
class JointWalker {
 public:
  /// `model`: with lifts; outlives it.
  JointWalker(const CureModel& model, std::size_t columns);

  /// A slice's layer, what it shows (`pixel_curve` of the model), and what is designed, with coverage.
  void add_slice(int slice, std::span<const ImageShowing> showings, const DesignRow& design,
                 bool at_heights);
  /// After the first slice. Adds what was found.
  void finish(JointFigures& figures);

 private:
  /// What a layer's own exposure leaves in it.
  struct Own {
    double greatest = 0;  ///< the greatest dose: from 1 on some of it gels
    double joint = 0;     ///< at its far edge
    bool film = false;    ///< as much of it gels as of a film
  };
  struct Column {
    /// Of the lowest layer that nothing solid is known to lie above.
    Own candidate;
    std::int32_t liquid = 0;      ///< liquid layers right above it, up to the layer added last
    std::int32_t edge_node = -1;  ///< upper node of the feature below the present gap; -1: none
    double edge_um = 0;           ///< how far its edge reaches beyond, exchanged
    double staying_um = 0;        ///< the same where no resin is
    double beyond_um = 0;         ///< edge height: what of it belongs to the feature
    bool goes_on = false;         ///< it goes into the next layer of the gap, too, where none is
    bool full = false;            ///< the layer added last is of a feature
  };
  void join(const Own& own);
  Own own_of(int slice, std::size_t column, std::span<const ImageShowing> showings);
  void take_light(int slice, std::span<const ImageShowing> showings,
                  std::vector<double>& light) const;
  bool inhibited() const { return model_.inhibited() != nullptr; }
  void end_feature(Column& c);
  void begin_gap(Column& c, int node, double exchanged, std::uint8_t height);
  void begin_staying(Column& c, int node, double below, double above);
  void go_on(Column& c, int node, double above);
  double reach_um(double dose, int node) const;
  /// From one node down to another, um.
  double between_um(int from, int to) const {
    return model_.heights.alike() ? (to - from) * model_.layer_um
                                  : (model_.depth(to) - model_.depth(from)) * model_.layer_um;
  }
  void end_gap(Column& c, int node);

  const CureModel& model_;
  PixelCurve curve_;
  /// Whether edges are told that single exposures, and all of them, leave: of sums of light in resin without
  /// end.
  bool tells_edges_;
  std::optional<OwnDoses> under_uv_;
  std::vector<double> phi_;          ///< of each column, with its exposure; without UV light
  std::vector<double> from_beside_;  ///< what light from beside adds to that; empty: nothing
  std::vector<Column> columns_;
  /// The brightest exposure so far, at the window of the layer that comes next.
  std::vector<double> brightest_;
  std::vector<double> all_;            ///< all exposures so far, there
  std::vector<std::uint8_t> heights_;  ///< edge heights of the node between the layers
  JointFigures figures_;
};

}  // namespace slicecorr::detail
