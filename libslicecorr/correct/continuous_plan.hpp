// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What all columns of a continuous correction share, in the form that their search needs.
///
/// The rules of one layer, in w = Omega(n + 1) and phi, the dose at its lower node and its light:
/// Omega(n) = phi b + a w with b = 1 - a, and at the fraction f from the lower node
/// Omega = phi + (w - phi) a^f. So "at least T at f" is w >= T A - phi (A - 1) with A = a^-f, a
/// *corner* of the doses and lights that a layer allows, and "less than T" the same the other way.
///
/// Where slices count for more than others (`CureModel::ratio`), black and full light of slice n are
/// ratio(n) times `phi_min` and `phi_max`, and what a curve of black or of full light tends to depends
/// on where it is: R(k) = ratio(k) b + a R(k + 1) times them at node k, since
/// Omega(k + j) = R(k + j) phi + (Omega(k) - R(k) phi) a^-j.
///
/// Slices of different heights have an a, and corners, of their own (`LayerFactors`); a^-j becomes what a
/// dose grows by through the slices that are passed (`grown_through`), and R(k) = ratio(k) b_k + a_k R(k + 1).
///
/// An edge lies at its node, or where its edge height says (target.hpp): then one of the two layers
/// beside it has a piece of the other run in it, and corners of both kinds.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "correct/coverage.hpp"
#include "slicecorr/cure.hpp"
#include "slicecorr/process.hpp"
#include "slicecorr/target.hpp"

namespace slicecorr::detail {

/// Relative doses from `lo` to `hi`; empty where lo > hi.
struct DoseRange {
  double lo = 0, hi = 0;
  bool operator==(const DoseRange&) const = default;
};
/// What two ranges have in common.
inline DoseRange common(DoseRange a, DoseRange b) {
  return {std::max(a.lo, b.lo), std::min(a.hi, b.hi)};
}

/// The corner (see above) of a point at a distance from its layer's lower node.
struct Corner {
  double grown = 1;   ///< A = a^-f, f the distance in slices
  double excess = 0;  ///< A - 1
  double per_excess = 0;
};

/// What a layer asks of its light and doses.
struct LayerRule {
  std::uint8_t coverage = 0;
  int corners = 0;
  std::array<Corner, 3> corner;
  /// Where edges lie inside the layer: corners of the other kind, of the runs beyond them.
  int opposites = 0;
  std::array<Corner, 2> opposite;
};

/// What an edge asks of the layer on one side of it.
struct SideAsk {
  bool own = false, other = false;
  Corner of_own;    ///< of the layer's own kind
  Corner of_other;  ///< of the kind beyond the edge, where that reaches into the layer
};
/// What an edge asks of both layers beside it.
struct EdgeAsk {
  SideAsk above, below;
};

/// Number of rungs: tolerances of edges, from the one aimed at to nearly half a slice.
inline constexpr int kRungs = 8;
/// The widest tolerance of edges, in slices: with it only the middles of layers count.
inline constexpr double kWidest = 0.4999;

/// Corners that keep edges within a tolerance of where they belong.
struct EdgeCorners {
  Corner upper, lower, slit;  ///< at upper ends of layers, lower ones, and above gaps of one slice
  double tolerance;           ///< in slices
  double slit_tolerance;      ///< upwards, of edges above gaps of one slice
};

/// What a layer makes of light and doses by its height.
struct LayerFactors {
  LayerFactors(double a, double one_minus_a, double root_a)
      : a(a), b(one_minus_a), root_a(root_a), per_a(1.0 / a), per_b(1.0 / one_minus_a) {}

  double a, b, root_a, per_a, per_b;
  double height = 1;  ///< over that of a layer as a rule
  Corner middle;
  std::array<EdgeCorners, kRungs> near{};  ///< per rung
  /// Greatest dose that the lower edge of a feature above the layer may have, per rung.
  std::array<double, kRungs> edge_most{};
  /// Range of doses of a full layer's node beside a grey one, per rung.
  std::array<double, kRungs> grey_edge_most{};

  Corner corner(double f) const;
  double step(double phi, double below) const { return phi * b + a * below; }
};

/// Its own factors are those of a layer as a rule.
struct ContinuousPlan : LayerFactors {
  /// `exact`: any light between black and full, edges at their nodes; for
  /// solve_column_exactly(). `like`: a plan of the same slices and resin, whose table it shares; null:
  /// none.
  ContinuousPlan(const CureModel& model, const Process& process, int slices, bool exact,
                 const ContinuousPlan* like = nullptr);

  double phi_min, phi_max;  ///< of a slice that counts as a normal one
  /// What full light counts for at least: less than phi_max where the bath ends. Doses that full
  /// light must still reach are planned by it.
  double climb_max;
  double layer_um;
  bool exact;
  double shortfall;   ///< `Process::gap_shortfall`, in slices
  LevelTable levels;  ///< each phi once: by index, not by grey level
  std::vector<std::uint8_t> level_of;
  double largest_step;  ///< of dose at a node, between two neighbouring levels
  double close;         ///< this near below a dose, no level but black stays below it

  /// A dose of `prints` or more prints, one of `open` or less does not: 1 with a margin for
  /// rounding. Checks of a choice allow doses to be off by `slack`, half of that margin.
  double prints, open, slack;
  double edge_room;  ///< rounding that the greatest dose of an edge allows for
  double most;       ///< no dose can be above it
  double cap;        ///< greatest dose in features
  double platform_cap;
  double least_cap;  ///< least cap of thin features, since a lower one would cost voxels
  std::array<double, kRungs> tolerance;  ///< in slices, rising; the first two are the same
  /// Before an edge the levels of this many slices are chosen together.
  int together;
  /// Range of dose that rung 0 keeps free `together` slices before an edge, so that the levels
  /// after that can raise the dose as well as lower it.
  double feature_reserve, gap_reserve;
  bool shelves;                   ///< whether features over gaps gel a shelf early
  std::span<const double> grown;  ///< a^-j, by j
  /// Where light from the platform multiplies doses: what a node of a feature must have, `j` nodes
  /// from the edge for which the plan is made, by j; empty: `prints`.
  std::vector<double> prints_inside;
  bool mirrored = false;  ///< whether there is one
  double prints_at(int j) const {
    const auto k = static_cast<std::size_t>(j);
    return k < prints_inside.size() ? prints_inside[k] : prints;
  }

  /// Corners in a layer; the tolerance is one of a layer as a rule.
  EdgeCorners corners_of(const LayerFactors& layer, double tolerance) const;
  /// Tolerances from the one aimed at upwards, each 1.2 times the one before.
  std::vector<EdgeCorners> ladder;
  int grey_rung;  ///< first rung whose `grey_edge_most` leaves room for a level step near 1

  /// What an edge of this height asks. `slit`: below it lies a gap of one slice.
  EdgeAsk ask(std::uint8_t height, const EdgeCorners& at, bool slit) const;
  /// Greatest dose at the node of the lower edge of a feature, so that the gap below opens in time; `node`
  /// counts where slices differ.
  double most_at_edge(int node, std::uint8_t height, int rung) const;
  /// Whether an edge of this height and rung lies at its node to the last bit: the node says it all.
  bool at_node(std::uint8_t height, int rung) const {
    return exact && rung == 0 && height == kEdgeAtNode;
  }

  /// The factors of a slice.
  const LayerFactors& of(int slice) const {
    return own_.empty() ? *this : own_[held(own_of_, slice)];
  }
  /// What a dose at `node` was `slices` slices further down without light between: a^-slices.
  double grown_through(int node, int slices) const {
    return own_.empty() ? grown[static_cast<std::size_t>(slices)] : grown_unevenly(node, slices);
  }
  /// Of a range that is kept free before edges, what slices as high as `slice` need.
  double reserve_at(int slice, double reserve) const {
    return ratio(slice) * (own_.empty() ? reserve : reserve * of(slice).b * per_b);
  }

  /// What a slice counts for over a normal one (`CureModel::ratio`).
  double ratio(int slice) const { return ratios_.empty() ? 1.0 : held(ratios_, slice); }
  /// Whether slices differ in what they count for or in height: edges then have places.
  bool uneven() const { return !steady_.empty(); }
  /// The dose at a node if all slices from there on showed black, or full light that counts for what
  /// climbs are planned with: what falling and climbing curves tend to there.
  double black_from(int node) const { return phi_min * (uneven() ? held(steady_, node) : 1.0); }
  double full_from(int node) const { return climb_max * (uneven() ? held(steady_, node) : 1.0); }

 private:
  /// By slice or node; the last holds for later ones.
  template <typename T>
  static T held(const std::vector<T>& values, int at) {
    const auto k = static_cast<std::size_t>(std::max(0, at));
    return k < values.size() ? values[k] : values.back();
  }
  double grown_unevenly(int node, int slices) const;
  void set_edges(LayerFactors& layer) const;
  void set_own(const CureModel& model);
  void set_steady();

  std::vector<double> ratios_;  ///< empty: all 1
  /// b times the sum of ratio(k + i) a^i, by node k; empty: slices do not differ.
  std::vector<double> steady_;
  double greatest_ = 1;              ///< ratio of all slices
  std::vector<LayerFactors> own_;    ///< one for each height; empty: all are as high
  std::vector<std::size_t> own_of_;  ///< which of them, by slice
  LayerHeights heights_;
  double per_um_ = 0;  ///< by how much the logarithm of a dose falls
  std::shared_ptr<const std::vector<double>> all_grown_;
  std::array<double, 256> height_grown_;  ///< a^-d by edge height, d in slices
};

}  // namespace slicecorr::detail
