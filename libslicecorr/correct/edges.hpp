// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// The edges of columns, and the doses at them from which everything above can be printed.
///
/// An edge is a node between two runs of layers of different coverage. What may be at it follows
/// from the runs above it, and from no more of them than lie near: columns that are alike there
/// share an `Edge`. Doses are those of docs/levels.md: of all doses at a node the ones from which
/// the layers above it can be printed, with any light between black and full.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <limits>
#include <map>
#include <optional>
#include <span>
#include <vector>

#include "correct/continuous_plan.hpp"
#include "correct/edge_keys.hpp"

namespace slicecorr::detail {

/// Doses at a node from which some sequence of levels prints everything above it: intervals that
/// rise and don't touch.
using DoseSet = std::vector<DoseRange>;

/// Doses at an edge of one rung: at the edge itself, where the run below is a gap of one slice
/// (`at_slit`), and one node further down, where the run below goes on.
struct RungDoses {
  DoseRange at, at_slit, inside;
};

/// Where rungs are so narrow that levels matter: the doses from which some sequence of levels leads
/// on, at an edge, at an edge above a gap of one slice, and at the nodes further down until they are
/// one interval again, which is `inside`.
struct EdgeLevels {
  DoseSet at, at_slit;
  std::vector<DoseSet> below;
  DoseRange inside{};
};

struct Edge {
  static constexpr std::int32_t kNone = -1;
  std::int32_t above = kNone;  ///< the next edge above
  /// Slices from the next edge above to this one; 0: so many that nothing above matters.
  std::int32_t slices = 0;
  std::int32_t node =
      0;  ///< where slices count for more than others (ContinuousPlan::uneven); else 0
  std::uint8_t above_cover = 0, below = 0;  ///< coverage on both sides
  std::uint8_t height = kEdgeAtNode;        ///< its edge height
  bool platform = false;                    ///< the run below lies on the platform: node 0
  bool endless = false;  ///< no real edge: the inside of a run whose upper end is too far to matter
  /// Of rung 0 and of the last one. The others, for which hardly an edge is asked, are worked out when
  /// it is, and have this place in Edges.
  RungDoses finest{}, widest{};
  mutable std::int32_t between = kNone;
  std::int32_t levels = kNone;  ///< place of its EdgeLevels in Edges; kNone: levels do not matter
  /// Rung 0 from `together` nodes further down on: the greatest dose of a feature, the least of a
  /// gap there.
  double reserved = 0;
  bool has_reserve = false;
  /// Beyond so many nodes further down rung 0 leaves room for the light of a shelf; 0: none.
  std::int32_t shelf = 0;
  double below_shelf = 0;  ///< rung 0: the greatest dose at the node after `shelf`
  double cap = 0;          ///< of the run below, if it is a feature
  std::int32_t far = 0;  ///< if the run below has so many slices, nothing below it depends on this
  /// Slices below the edge from which on full light always fits (`bright_from`), black light fits
  /// while it keeps the dose close to the falling curve (`falls_from`), and black light always fits
  /// (`dark_from`). `kNever`: nowhere.
  std::int32_t bright_from = kNever, falls_from = kNever, dark_from = kNever;
  std::int32_t capped_from = kNever;  ///< from there on the falling curve is above the cap
  /// From so many slices below on, all doses of rung 0 are among those for which there are levels.
  std::int32_t levels_until = 0;

  bool has_levels() const { return levels != kNone; }

  static constexpr std::int32_t kNever = std::numeric_limits<std::int32_t>::max();
};

/// All edges of a band's columns. Not thread-safe.
class Edges {
 public:
  /// `shelves`: as the plan says; false: none.
  explicit Edges(const ContinuousPlan& plan, bool shelves = true);

  /// The platform above a run of this coverage. `node`: where the run begins, if what lies above it does
  /// not matter any more.
  std::int32_t platform(std::uint8_t below, int node = 0);
  /// The edge `slices` below edge `id`, with this coverage on its lower side, and this edge height, at
  /// `node`, which counts where slices differ.
  std::int32_t next(std::int32_t id, int slices, std::uint8_t below, std::uint8_t height, int node);
  /// The lower end, `slices` below edge `id`, of what is left alone: from there on a run of coverage
  /// `below` begins. What is left alone asks nothing, but its `light`, a dose at edge `id`, and what
  /// the run below leaves must suit the runs above. `id` kNone: it lies on the platform. `of_one`: the
  /// dose at edge `id` that gels there, where light from the platform makes it differ from 1.
  std::int32_t through(std::int32_t id, int slices, double light, double of_one, std::uint8_t below,
                       int node);
  /// An edge between two greys depends on these two alone: its id says which they are, and the edge
  /// stands for the inside of the lower one.
  const Edge& operator[](std::int32_t id) const {
    const std::int32_t kept = id & kGreyPair ? endless_[0][id & 255] : id;
    return edges_[static_cast<std::size_t>(kept)];
  }
  /// Coverage above an edge.
  std::uint8_t cover_above(std::int32_t id) const {
    return id & kGreyPair ? static_cast<std::uint8_t>(id >> 8) : (*this)[id].above_cover;
  }
  /// Least dose `j` nodes below the upper edge of a grey run.
  double grey_least_at(std::int32_t id, int j) const {
    if (id & kGreyPair && j == 0) return grey_least(0, cover_above(id), false, (*this)[id].below);
    return doses((*this)[id], j, 0).lo;
  }

  /// Doses `j` nodes below an edge, in the run below it; `slit`: j is 0 and that run is a gap of
  /// one slice.
  DoseRange doses(const Edge& edge, int j, int rung, bool slit = false) const;
  /// Greatest dose inside the run below an edge, a feature. The last rung has room for the levels
  /// of thin features: voxels come before the cap.
  double cap(const Edge& edge, int rung) const {
    return rung + 1 < kRungs ? edge.cap : std::max(edge.cap, plan_.least_cap);
  }
  /// Whether some sequence of levels prints everything above, given `dose` at the node `j` below
  /// the edge. True also where `doses` alone ensures it.
  bool levels_allow(const Edge& edge, int j, double dose, bool slit = false) const {
    return !edge.has_levels() || levels_allow_kept(edge, j, dose, slit);
  }

  /// The rule of a layer. `upper`, `lower`: what the edges at its ends ask of it, at which a feature
  /// meets a gap; null: none does.
  LayerRule rule(const LayerFactors& layer, std::uint8_t coverage, const SideAsk* upper,
                 const SideAsk* lower) const;
  /// Doses at the lower node of the layer of `slice` from which some light leads into `above` at its
  /// upper one; false: none.
  bool back(const LayerRule& rule, int slice, DoseRange above, DoseRange& below) const;

  const ContinuousPlan& plan() const { return plan_; }

 private:
  /// As back(), where not all layers above can print as designed: features do, gaps may close.
  DoseRange for_features(LayerRule layer, int slice, DoseRange above, DoseRange limits) const;
  static constexpr std::int32_t kGreyPair = 1 << 30;
  /// What an endless run had above it.
  enum class Hidden { nothing, platform, under_full };
  std::int32_t endless(std::uint8_t coverage, Hidden hidden);
  /// Least dose at the lower node of a grey run that its own layers ask for; `slice`: its last, which counts
  /// under a full layer.
  double grey_least(int slice, std::uint8_t grey, bool under_full, std::uint8_t below) const;
  std::int32_t keep(const EdgeKey& key);
  std::int32_t make(const Edge& above, const EdgeKey& key);
  /// back() of a layer with corners of both kinds.
  bool back_both_ways(const LayerRule& rule, int slice, DoseRange above, DoseRange& below) const;
  /// Fills the doses of an edge below `above`, of rung 0 and of the last.
  void set_edge(Edge& edge, const Edge& above) const;
  /// Fills the doses of an edge that has these at itself, of all rungs.
  void set_edge(Edge& edge, std::span<const DoseRange> at) const;
  /// Sets the shelf of a feature over a gap.
  void set_shelf(Edge& edge) const;
  /// Fills all that follows from the doses.
  void set_inside(Edge& edge) const;
  void set_levels(Edge& edge, const Edge* above);
  /// Doses of a rung; the narrower ones are among the `wider`, and these where there are none. True:
  /// there are.
  bool narrow(const Edge& edge, const Edge& above, int rung, const RungDoses& wider,
              RungDoses& to) const;
  std::optional<DoseRange> at_edge(const Edge& edge, const Edge& above, int rung, bool slit) const;
  std::optional<DoseRange> at_inside(const Edge& edge, int rung, DoseRange at) const;
  const RungDoses& of_rung(const Edge& edge, int rung) const {
    return rung == 0 ? edge.finest : rung + 1 == kRungs ? edge.widest : of_rung_between(edge, rung);
  }
  const RungDoses& of_rung_between(const Edge& edge, int rung) const;
  void set_between(const Edge& edge) const;
  const EdgeLevels& levels_of(const Edge& edge) const {
    return levels_[static_cast<std::size_t>(edge.levels)];
  }
  bool levels_allow_kept(const Edge& edge, int j, double dose, bool slit) const;
  DoseSet levels_at(const Edge& edge, int j, bool slit) const;
  /// levels_allow() further down than sets are kept: the doses are one interval there.
  DoseRange levels_inside(const Edge& edge, int j) const;
  DoseSet levels_back(const LayerRule& rule, int slice, const DoseSet& above,
                      DoseRange within) const;
  bool wide(const DoseSet& doses) const;
  /// Range of doses at nodes inside a run.
  DoseRange inside_of(const Edge& edge, int rung) const;

  const ContinuousPlan& plan_;
  const bool shelves_;
  struct Through {
    std::int32_t edge, slices;
    double light, of_one;
    std::uint8_t below;
    std::int32_t node;
    // clang-tidy 14 takes its comparison with 0 for one with a null pointer.
    auto operator<=>(const Through&) const = default;  // NOLINT(modernize-use-nullptr)
  };
  std::map<Through, std::int32_t> through_;
  std::vector<Edge> edges_;
  /// Of rungs 1 to kRungs - 2.
  using Between = std::array<RungDoses, static_cast<std::size_t>(kRungs) - 2>;
  mutable std::deque<Between> between_;
  std::deque<EdgeLevels> levels_;
  EdgeIds ids_;
  std::array<std::array<std::int32_t, 256>, 3> endless_;
};

/// Whether a full layer borders on an empty one.
inline bool opposite(std::uint8_t a, std::uint8_t b) {
  return (a == kFull && b == 0) || (a == 0 && b == kFull);
}

}  // namespace slicecorr::detail
