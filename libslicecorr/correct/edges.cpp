// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "correct/edges.hpp"

#include <algorithm>
#include <array>

namespace slicecorr::detail {

namespace {

/// Most different edges of a band; beyond them, which happens in noise only, runs count as endless.
constexpr std::size_t kMostEdges = std::size_t{1} << 17;

/// The grey that stands for all greys above full layers.
constexpr std::uint8_t kAnyGrey = 128;

}  // namespace

Edges::Edges(const ContinuousPlan& plan, bool shelves)
    : plan_(plan), shelves_(shelves && plan.shelves) {
  for (auto& kind : endless_) kind.fill(Edge::kNone);
}

LayerRule Edges::rule(const LayerFactors& layer, std::uint8_t coverage, const SideAsk* upper,
                      const SideAsk* lower) const {
  LayerRule rule;
  rule.coverage = coverage;
  if (coverage != 0 && coverage != kFull) return rule;
  rule.corner[0] = layer.middle;
  rule.corners = 1;
  for (const SideAsk* ask : {upper, lower}) {
    if (!ask) continue;
    if (ask->own) rule.corner[static_cast<std::size_t>(rule.corners++)] = ask->of_own;
    if (ask->other) rule.opposite[static_cast<std::size_t>(rule.opposites++)] = ask->of_other;
  }
  return rule;
}

bool Edges::back(const LayerRule& rule, int slice, DoseRange above, DoseRange& below) const {
  const ContinuousPlan& p = plan_;
  if (rule.opposites > 0) return back_both_ways(rule, slice, above, below);
  const LayerFactors& f = p.of(slice);
  const double black = p.ratio(slice) * p.phi_min, full = p.ratio(slice) * p.climb_max;
  if (rule.coverage == kFull) {
    double x = full;
    for (int k = 0; k < rule.corners; ++k) {
      const Corner& c = rule.corner[static_cast<std::size_t>(k)];
      x = std::min(x, (above.hi * f.per_a - p.prints * c.grown) / (f.per_a - c.grown));
    }
    if (x < black) return false;
    below.lo = std::max(0.0, (above.lo - x * f.b) * f.per_a);
    for (int k = 0; k < rule.corners; ++k) {
      const Corner& c = rule.corner[static_cast<std::size_t>(k)];
      below.lo = std::max(below.lo, p.prints * c.grown - x * c.excess);
    }
    below.hi = (above.hi - black * f.b) * f.per_a;
  } else if (rule.coverage == 0) {
    double most = full, least = black;
    for (int k = 0; k < rule.corners; ++k) {
      const Corner& c = rule.corner[static_cast<std::size_t>(k)];
      most = std::min(most, p.open * c.grown * c.per_excess);
      least = std::max(least, (above.lo * f.per_a - p.open * c.grown) / (f.per_a - c.grown));
    }
    if (least > full) return false;
    below.lo = std::max(0.0, (above.lo - most * f.b) * f.per_a);
    below.hi = (above.hi - least * f.b) * f.per_a;
    for (int k = 0; k < rule.corners; ++k) {
      const Corner& c = rule.corner[static_cast<std::size_t>(k)];
      below.hi = std::min(below.hi, p.open * c.grown - least * c.excess);
    }
  } else {
    // Doses of grey layers stay below what gaps above them could not take.
    below.lo = std::max(0.0, (above.lo - full * f.b) * f.per_a);
    below.hi = p.most;
  }
  if (below.hi < 0 || below.lo > below.hi + p.slack) return false;
  below.hi = std::max(below.hi, below.lo);
  return true;
}

bool Edges::back_both_ways(const LayerRule& rule, int slice, DoseRange above,
                           DoseRange& below) const {
  const ContinuousPlan& p = plan_;
  const LayerFactors& f = p.of(slice);
  const double ratio = p.ratio(slice);
  // Bounds of phi, each at - per w, in w = Omega(n + 1). There is a phi between them where every
  // bound from below lies under every bound from above, which bounds w in turn.
  struct Line {
    double at, per;
  };
  std::array<Line, 7> least, most;
  std::size_t leasts = 0, mosts = 0;
  least[leasts++] = {ratio * p.phi_min, 0.0};
  most[mosts++] = {ratio * p.climb_max, 0.0};
  least[leasts++] = {above.lo * f.per_b, f.a * f.per_b};
  most[mosts++] = {above.hi * f.per_b, f.a * f.per_b};
  const auto add = [&](const Corner& c, bool prints) {
    if (prints) {
      least[leasts++] = {p.prints * c.grown * c.per_excess, c.per_excess};
    } else {
      most[mosts++] = {p.open * c.grown * c.per_excess, c.per_excess};
    }
  };
  const bool feature = rule.coverage == kFull;
  for (int k = 0; k < rule.corners; ++k) add(rule.corner[static_cast<std::size_t>(k)], feature);
  for (int k = 0; k < rule.opposites; ++k)
    add(rule.opposite[static_cast<std::size_t>(k)], !feature);
  below = {0.0, p.most};
  for (std::size_t i = 0; i < leasts; ++i) {
    for (std::size_t j = 0; j < mosts; ++j) {
      const double rise = most[j].per - least[i].per, room = most[j].at - least[i].at;
      if (rise > 0) {
        below.hi = std::min(below.hi, room / rise);
      } else if (rise < 0) {
        below.lo = std::max(below.lo, room / rise);
      } else if (room < -p.slack) {
        return false;
      }
    }
  }
  if (below.lo > below.hi + p.slack) return false;
  below.hi = std::max(below.hi, below.lo);
  return true;
}

DoseRange Edges::for_features(LayerRule layer, int slice, DoseRange above, DoseRange limits) const {
  (layer.coverage == 0 ? layer.corners : layer.opposites) = 0;
  DoseRange below{0.0, plan_.most};
  back(layer, slice, {above.lo, plan_.most}, below);
  below.lo = std::max(below.lo, limits.lo);
  return {below.lo, std::max(below.lo, limits.hi)};
}

double Edges::grey_least(int slice, std::uint8_t grey, bool under_full, std::uint8_t below) const {
  if (below == kFull) return plan_.prints;
  if (below != 0) return std::min(aim_of(grey), aim_of(below));
  if (!under_full) return aim_of(grey);
  // Its middle gets its coverage: the middle is (Omega(n) + r Omega(n + 1)) / (1 + r),
  // r = sqrt(a), and Omega(n) = 1.
  const double r = plan_.of(slice).root_a;
  return std::max(0.0, ((1.0 + r) * aim_of(grey) - 1.0) / r);
}

std::int32_t Edges::platform(std::uint8_t below, int node) {
  if (!plan_.uneven()) node = 0;
  const EdgeKey key{Edge::kNone, 0, below, kEdgeAtNode, node};
  if (const std::int32_t found = ids_.find(key); found != Edge::kNone) return found;
  Edge edge;
  edge.above_cover = edge.below = below;
  edge.node = node;
  edge.platform = true;
  edge.cap = plan_.platform_cap;
  std::array<DoseRange, kRungs> at;
  for (int r = 0; r < kRungs; ++r) {
    DoseRange all = inside_of(edge, r);
    if (is_grey(below)) all.lo = 0;
    at[static_cast<std::size_t>(r)] = all;
  }
  set_edge(edge, at);
  set_inside(edge);
  edges_.push_back(edge);
  const auto id = static_cast<std::int32_t>(edges_.size() - 1);
  ids_.put(key, id);
  return id;
}

std::int32_t Edges::endless(std::uint8_t coverage, Hidden hidden) {
  std::int32_t& known = endless_[static_cast<std::size_t>(hidden)][coverage];
  if (known != Edge::kNone) return known;
  Edge edge;
  edge.above_cover = hidden == Hidden::under_full ? kFull : coverage;
  edge.below = coverage;
  edge.platform = hidden == Hidden::platform;
  edge.endless = true;
  edge.cap = edge.platform ? plan_.platform_cap : plan_.cap;
  edges_.push_back(edge);
  return known = static_cast<std::int32_t>(edges_.size() - 1);
}

std::int32_t Edges::next(std::int32_t id, int slices, std::uint8_t below, std::uint8_t height,
                         int node) {
  const int last = node - 1;  // slice of the run above
  const LayerFactors& f = plan_.of(last);
  const double full = plan_.climb_max * plan_.ratio(last);
  if (!plan_.uneven()) node = 0;
  const Edge& above = (*this)[id];
  const std::uint8_t cover = above.below;  // the edge itself may move when others join
  if (is_grey(cover)) {
    // What a grey layer asks for itself is most often more than what those above it do.
    const bool under_full = slices == 1 && cover_above(id) == kFull && !above.platform;
    const double asked = grey_least_at(id, slices - 1);
    if ((asked - full * f.b) * f.per_a <= grey_least(last, cover, under_full, below)) {
      if (is_grey(below)) {
        endless(below, Hidden::nothing);
        return kGreyPair | static_cast<std::int32_t>(cover) << 8 | below;
      }
      // Full layers are the same under all greys.
      id = endless(below == kFull ? kAnyGrey : cover,
                   under_full && below == 0 ? Hidden::under_full : Hidden::nothing);
      slices = 0;
    } else if (id & kGreyPair) {
      const std::uint8_t first = cover_above(id);
      id = keep({endless(first, Hidden::nothing), 0, cover, kEdgeAtNode,
                 plan_.uneven() ? node - slices : 0});
    }
  } else if (slices >= above.far) {
    id = endless(cover, above.platform && cover == kFull ? Hidden::platform : Hidden::nothing);
    slices = 0;
  }
  if (slices > 0 && edges_.size() >= kMostEdges) {
    id = endless(cover, Hidden::nothing);
    slices = 0;
  }
  return keep({id, slices, below, opposite(cover, below) ? height : kEdgeAtNode, node});
}

std::int32_t Edges::through(std::int32_t id, int slices, double light, double of_one,
                            std::uint8_t below, int node) {
  if (!plan_.uneven()) node = 0;
  const auto [found, is_new] =
      through_.try_emplace({id, slices, light, of_one, below, node}, Edge::kNone);
  if (!is_new) return found->second;
  const ContinuousPlan& p = plan_;
  Edge edge;
  edge.above = id;
  edge.slices = slices;
  edge.node = node;
  edge.above_cover = edge.below = below;
  edge.cap = p.cap;
  const double left = 1.0 / p.grown_through(node - slices, slices);
  std::array<DoseRange, kRungs> of_rungs;
  for (int r = 0; r < kRungs; ++r) {
    DoseRange at{0.0, p.most};
    if (id != Edge::kNone) {
      DoseRange from = doses((*this)[id], 0, r);
      if ((*this)[id].below == kFull) from.lo = std::max(from.lo, std::min(p.prints, from.hi));
      // As near as can be, where no dose would do.
      at.lo = std::clamp((from.lo * of_one - light) / left, 0.0, p.full_from(node));
      at.hi = std::clamp((from.hi * of_one - light) / left, at.lo, p.most);
    }
    of_rungs[static_cast<std::size_t>(r)] = at;
  }
  set_edge(edge, of_rungs);
  set_inside(edge);
  edges_.push_back(edge);
  return found->second = static_cast<std::int32_t>(edges_.size() - 1);
}

std::int32_t Edges::keep(const EdgeKey& key) {
  std::int32_t id = ids_.find(key);
  if (id == Edge::kNone) {
    id = make((*this)[key.edge], key);
    ids_.put(key, id);
  }
  return id;
}

std::int32_t Edges::make(const Edge& above, const EdgeKey& key) {
  Edge edge;
  edge.above = key.edge;
  edge.slices = key.slices;
  edge.above_cover = above.below;
  edge.below = key.below;
  edge.height = key.height;
  edge.node = key.node;
  edge.cap = plan_.cap;
  set_edge(edge, above);
  set_inside(edge);
  if (!plan_.exact && opposite(edge.above_cover, edge.below))
    set_levels(edge, above.endless ? nullptr : &above);
  edges_.push_back(edge);
  return static_cast<std::int32_t>(edges_.size() - 1);
}

}  // namespace slicecorr::detail
