// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file sweep.hpp
/// What `SectionSweep` keeps: the plan's rows, light per level, and factored matrices.
#pragma once

#include <memory>
#include <vector>

#include "cell_law.hpp"
#include "gap_band.hpp"
#include "kept_room.hpp"
#include "net.hpp"
#include "slicecorr/flow_section.hpp"

namespace slicecorr {

struct SectionSweep::Impl {
  Impl(const FlowSection& section, const GapPressure& pressure, const FlowResin& resin,
       double speed_mm_h, std::span<const double> gap_um, const SweepOptions& options);

  /// One light per part node.
  struct NodeLight {
    std::vector<double> blue, uv;
  };
  /// Y of nodes and levels, (mW/cm²)^m·s, and, where the law is not linear, which piece of it holds.
  struct State {
    detail::KeptRoom::Room y;
    std::vector<detail::DosePiece> piece;
  };

  NodeLight light(std::span<const double> blue, std::span<const double> uv) const;
  State carry(const NodeLight& light) const;
  /// Transposed, from what the doses of front and window weigh; `light` null where linear.
  SectionGradient carry_back(std::span<const double> front, std::span<const double> window,
                             const NodeLight* light) const;
  SectionDose dose_of(const State& state, const NodeLight& light) const;
  /// The node of a cell of part; throws `InputError` for others.
  int node_at(int x, int y) const;

  std::size_t cells = 0;
  int width = 0;
  FlowResin resin;
  bool linear = true;
  detail::GapLevels levels;
  detail::FlowPath path;
  std::vector<double> gap;  ///< of part nodes, um
  bool even = true;         ///< the gap is
  double um_s = 0;          ///< S

 private:
  /// Light of levels of the node in hand; made anew only where gaps vary.
  class Light;
  double spread(std::size_t node) const;
  /// The window's dose lies on the parabola without slope there: Y + bend (Y - Y above).
  double bend_at_window() const;
  /// Factors of one node, in three rows of levels.
  detail::BandView factor(std::size_t node, double* rows) const;
  detail::BandView kept(std::size_t node) const;
  /// What flows into a node, level by level.
  void enter(std::size_t node, const double* y, double* into) const;
  /// Transposed: hands `y` on to what flows in.
  void leave(std::size_t node, double* y, double* into) const;
  /// Puts what doses weigh into a node's profile.
  void weigh(std::size_t node, std::span<const double> front, std::span<const double> window,
             double* y) const;
  /// Solves nodes `from` to `to` of the order, one step, after `before(node, profile)`.
  template <typename Before, typename Solve, typename SolveOne>
  void beside(std::size_t from, std::size_t to, double* y, Before before, Solve solve,
              SolveOne solve_one) const;
  void carry_linear(const NodeLight& light, State& state) const;
  void carry_pieces(const NodeLight& light, State& state) const;
  SectionGradient back_linear(std::span<const double> front, std::span<const double> window) const;
  SectionGradient back_pieces(std::span<const double> front, std::span<const double> window,
                              const NodeLight& light, const State& state) const;

  /// Room for the profiles of all nodes.
  detail::KeptRoom::Room profiles() const { return room_.take(path.net.nodes() * levels.size()); }

  std::vector<double> factors_;  ///< where linear, of every node
  mutable detail::KeptRoom room_;
};

}  // namespace slicecorr
