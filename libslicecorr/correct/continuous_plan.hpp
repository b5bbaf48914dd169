/// What all columns of a continuous correction share, in the form that their search needs.
///
/// The rules of one layer, in w = Omega(n + 1) and phi, the dose at its lower node and its light:
/// Omega(n) = phi b + a w with b = 1 - a, and at the fraction f from the lower node
/// Omega = phi + (w - phi) a^f. So "at least T at f" is w >= T A - phi (A - 1) with A = a^-f, a
/// *corner* of the doses and lights that a layer allows, and "less than T" the same the other way.
#pragma once

#include <array>
#include <cmath>
#include <cstdint>
#include <vector>

#include "correct/coverage.hpp"
#include "slicecorr/cure.hpp"
#include "slicecorr/process.hpp"

namespace slicecorr::detail {

/// Doses from `lo` to `hi`.
struct DoseRange {
  double lo = 0, hi = 0;
  bool operator==(const DoseRange&) const = default;
};

/// What a point of a layer asks for, at a distance from its lower node.
struct Corner {
  double grown = 1;   ///< A = a^-f, f the distance in slices
  double excess = 0;  ///< A - 1
  double per_excess = 0;
};

/// A layer as its light is chosen.
struct LayerRule {
  std::uint8_t coverage = 0;
  int corners = 0;
  std::array<Corner, 3> corner;
};

/// Tolerances of edges, from the one aimed at to nearly half a slice.
inline constexpr int kRungs = 8;
/// With this tolerance of edges only the middle of layers counts.
inline constexpr double kWidest = 0.4999;

/// Where edges may lie.
struct EdgeCorners {
  Corner upper, lower, slit;  ///< at upper ends of layers, lower ones, and above gaps of one slice
  double tolerance;           ///< in slices
};

struct ContinuousPlan {
  /// `exact`: any light between black and full, edges at their nodes; for
  /// solve_column_exactly().
  ContinuousPlan(const CureModel& model, const Process& process, int slices, bool exact);

  double a, b, root_a, per_a, per_b;
  double phi_min, phi_max;
  double layer_um;
  bool exact;
  bool merge;         ///< gaps of one slice count as full
  double shortfall;   ///< of edges above gaps of one slice, in slices
  LevelTable levels;  ///< each phi once: by index, not by grey level
  std::vector<std::uint8_t> level_of;
  double largest_step;  ///< of dose at a node, between two neighbouring levels
  double close;         ///< this much below a dose, only black stays below it

  /// Doses that print and that don't, with the margin for rounding; checks of choices leave out
  /// half of it.
  double prints, open, slack;
  double most;  ///< no dose is above
  double cap;   ///< of features
  double platform_cap;
  double least_cap;                      ///< where a lower one would cost voxels
  std::array<double, kRungs> tolerance;  ///< in slices, rising; the first two are the same
  /// Before an edge the levels of this many slices are chosen together.
  int together;
  /// What rung 0 keeps free at that distance, so that these levels can go both ways.
  double feature_reserve, gap_reserve;
  std::vector<double> grown;  ///< a^-j

  Corner corner(double f) const;
  Corner middle;
  std::array<Corner, kRungs> near_lower, near_upper, slit_lower;  ///< per rung
  /// Tolerances from the one aimed at upwards, each 1.2 times the one before.
  std::vector<EdgeCorners> ladder;
  /// Most that the dose at the lower edge of a feature can be, per rung.
  std::array<double, kRungs> edge_most;
  /// Range of doses of a full layer's node beside a grey one, per rung.
  std::array<double, kRungs> grey_edge_most;
  int grey_rung;  ///< the first of them in which a step of levels near 1 fits

  /// Whether edges of a rung lie at their nodes to the last bit.
  bool at_nodes(int rung) const { return exact && rung == 0; }
  /// Corners of layers whose upper or lower node is an edge; null where the node says it all.
  const Corner* upper_corner(int rung) const {
    return at_nodes(rung) ? nullptr : &near_upper[static_cast<std::size_t>(rung)];
  }
  const Corner* lower_corner(int rung, bool above_slit) const {
    const auto r = static_cast<std::size_t>(rung);
    return above_slit ? &slit_lower[r] : at_nodes(rung) ? nullptr : &near_lower[r];
  }

  double step(double phi, double below) const { return phi * b + a * below; }
};

}  // namespace slicecorr::detail
