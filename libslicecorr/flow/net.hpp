// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file net.hpp
/// A section as a net: nodes are its part cells and, one each, its voids; links are faces. Pressure and
/// dose are solved on it.
#pragma once

#include <array>
#include <span>
#include <vector>

#include "slicecorr/flow_section.hpp"

namespace slicecorr::detail {

/// The neighbour of a part cell in a direction.
struct FlowFace {
  int node = -1;           ///< its node; -1: the outline
  double conductance = 0;  ///< flow per difference of Phi / 12: (h/reference)³ width / distance
  double theta = 1;        ///< distance of that from the cell's middle, pitches
};

/// Directions of faces: right, left, down, up; `d ^ 1` is the opposite one.
struct FlowNet {
  std::vector<int> node_of;                    ///< of cells; -1 in bath
  std::vector<std::size_t> cell_of;            ///< of part nodes, ascending
  std::vector<std::array<FlowFace, 4>> faces;  ///< of part nodes
  std::vector<double> area;                    ///< of all nodes, cells
  std::vector<double> leak;  ///< of voids: conductance to the bath where no part is between
  std::size_t parts() const { return cell_of.size(); }
  std::size_t nodes() const { return area.size(); }
};

/// `mobility`: (h/reference)³ of cells; empty: 1.
FlowNet make_net(const FlowSection& section, std::span<const double> mobility);

/// What flows through the net, and which nodes a node's dose comes from.
///
/// Of a node n with the dose Y in a level: diagonal Y - sum of weight * Y of `from` - outline * Y of
/// what enters = sum of out - sum of in, flows in units of S times the area of a cell. Faces take the
/// value that the slope upstream of them gives (second order); rows depend on the flow alone.
struct FlowRows {
  /// Nodes in the order of the flow: by steps from the outline, then by Phi and number. Nodes of one
  /// step don't depend on each other.
  std::vector<int> order;
  std::vector<std::size_t> step;   ///< where each step begins in `order`, and its end
  std::vector<std::size_t> begin;  ///< of `from` and `weight`, nodes + 1
  std::vector<int> from;
  std::vector<double> weight;
  std::vector<double> diagonal, outline;
};

/// `phi`: of nodes.
FlowRows make_rows(const FlowNet& net, std::span<const double> phi, double cell_um2);

/// Net and rows of a solved section.
struct FlowPath {
  /// `gap_um`: cells; empty: even.
  FlowPath(const FlowSection& section, const GapPressure& pressure, std::span<const double> gap_um);
  FlowNet net;
  FlowRows rows;
};

}  // namespace slicecorr::detail
