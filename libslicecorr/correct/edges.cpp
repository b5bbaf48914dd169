// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "correct/edges.hpp"

#include <algorithm>
#include <cmath>

namespace slicecorr::detail {

namespace {

/// Most intervals of doses that are kept per node; of more the widest are kept.
constexpr std::size_t kMostIntervals = 4096;
/// Most edges of a band for which sets of doses for levels are worked out: a part whose columns are
/// noise would take for ever otherwise.
constexpr std::size_t kMostLevelEdges = 8000;
/// Most different edges of a band; beyond them, which happens in noise only, runs count as endless.
constexpr std::size_t kMostEdges = std::size_t{1} << 17;

bool narrower(DoseRange d, double width) { return d.hi - d.lo < width; }

DoseRange common(DoseRange a, DoseRange b) { return {std::max(a.lo, b.lo), std::min(a.hi, b.hi)}; }

bool is_grey(std::uint8_t coverage) { return coverage != 0 && coverage != kFull; }

/// The grey that stands for all greys above full layers.
constexpr std::uint8_t kAnyGrey = 128;

}  // namespace

Edges::Edges(const ContinuousPlan& plan) : plan_(plan) {
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

DoseRange Edges::inside_of(const Edge& edge, int rung) const {
  if (edge.below == kFull) return {plan_.prints, cap(edge, rung)};
  if (edge.below == 0) return {0.0, plan_.open};
  return {aim_of(edge.below), plan_.most};
}

DoseRange Edges::doses(const Edge& edge, int j, int rung, bool slit) const {
  const ContinuousPlan& p = plan_;
  if (edge.endless) return inside_of(edge, rung);
  const auto r = static_cast<std::size_t>(rung);
  if (j == 0) return slit ? edge.at_slit[r] : edge.at[r];
  const DoseRange base = edge.inside[r];
  const int node = edge.node;
  const double g = p.grown_through(node + 1, j - 1);
  const double full = p.full_from(node + j), black = p.black_from(node + j);
  const double climbs = full - (p.full_from(node + 1) - base.lo) * g;
  if (is_grey(edge.below)) return {std::max(aim_of(edge.below), climbs), p.most};
  DoseRange d{climbs, black + (base.hi - p.black_from(node + 1)) * g};
  if (rung == 0 && edge.has_reserve && j >= p.together) {
    const double since = p.grown_through(node + p.together, j - p.together);
    if (edge.below == kFull) {
      d.hi = black + (edge.reserved - p.black_from(node + p.together)) * since;
    } else {
      d.lo = full - (p.full_from(node + p.together) - edge.reserved) * since;
    }
  }
  DoseRange bounds = inside_of(edge, rung);
  if (p.mirrored && edge.below == kFull) bounds.lo = p.prints_at(j);
  return {std::max(d.lo, bounds.lo), std::min(d.hi, bounds.hi)};
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
  const Key key{Edge::kNone, 0, below, kEdgeAtNode, node};
  const auto found = ids_.find(key);
  if (found != ids_.end()) return found->second;
  Edge edge;
  edge.above_cover = edge.below = below;
  edge.node = node;
  edge.platform = true;
  edge.cap = plan_.platform_cap;
  for (int r = 0; r < kRungs; ++r) {
    DoseRange all = inside_of(edge, r);
    if (is_grey(below)) all.lo = 0;
    edge.at[static_cast<std::size_t>(r)] = all;
  }
  set_inside(edge);
  edges_.push_back(std::move(edge));
  const auto id = static_cast<std::int32_t>(edges_.size() - 1);
  ids_.emplace(key, id);
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
  edges_.push_back(std::move(edge));
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
  for (int r = 0; r < kRungs; ++r) {
    DoseRange at{0.0, p.most};
    if (id != Edge::kNone) {
      DoseRange from = doses((*this)[id], 0, r);
      if ((*this)[id].below == kFull) from.lo = std::max(from.lo, std::min(p.prints, from.hi));
      // As near as can be, where no dose would do.
      at.lo = std::clamp((from.lo * of_one - light) / left, 0.0, p.full_from(node));
      at.hi = std::clamp((from.hi * of_one - light) / left, at.lo, p.most);
    }
    edge.at[static_cast<std::size_t>(r)] = edge.at_slit[static_cast<std::size_t>(r)] = at;
  }
  set_inside(edge);
  edges_.push_back(std::move(edge));
  return found->second = static_cast<std::int32_t>(edges_.size() - 1);
}

std::int32_t Edges::keep(const Key& key) {
  Recent& recent = recent_[Hash()(key) % recent_.size()];
  if (recent.key == key) return recent.id;
  const auto found = ids_.find(key);
  recent = {key, found != ids_.end() ? found->second : make((*this)[key.edge], key)};
  if (found == ids_.end()) ids_.emplace(key, recent.id);
  return recent.id;
}

std::int32_t Edges::make(const Edge& above, const Key& key) {
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
  edges_.push_back(std::move(edge));
  return static_cast<std::int32_t>(edges_.size() - 1);
}

void Edges::set_edge(Edge& edge, const Edge& above) const {
  const ContinuousPlan& p = plan_;
  const int last = edge.node - 1;  // slice of the run above
  const LayerFactors& f = p.of(last);
  const bool one = edge.slices == 1;
  const bool one_upper = one && !above.platform && opposite(above.above_cover, above.below);
  const bool in_slit = one_upper && above.below == 0 && edge.below == kFull;
  const bool lower = opposite(above.below, edge.below);
  const bool has_slit = above.below == kFull && edge.below == 0;
  const bool grey_above = above.below != 0 && above.below != kFull;
  const bool grey_below = edge.below != 0 && edge.below != kFull;
  DoseRange node{0.0, p.most};
  if (grey_above) {
    const bool under_full = (one || above.endless) && above.above_cover == kFull && !above.platform;
    node.lo = grey_least(last, above.below, under_full, edge.below);
  }
  for (int slit = 0; slit <= static_cast<int>(has_slit); ++slit) {
    auto& at = slit ? edge.at_slit : edge.at;
    for (std::size_t r = kRungs; r-- > 0;) {
      const int rung = static_cast<int>(r);
      DoseRange limits = node;
      if ((grey_above && edge.below == kFull) || (above.below == kFull && grey_below)) {
        limits = {p.prints, p.of(edge.node).grey_edge_most[r]};
      }
      if (has_slit) limits.hi = std::min(limits.hi, p.most_at_edge(edge.node, edge.height, rung));
      EdgeAsk upper_ask, lower_ask;
      if (one_upper && (in_slit || !p.at_node(above.height, rung)))
        upper_ask = p.ask(above.height, f.near[r], in_slit);
      if (lower && (slit || !p.at_node(edge.height, rung))) {
        lower_ask = p.ask(edge.height, f.near[r], slit != 0);
      } else if (lower) {
        limits = common(limits, {p.prints, p.prints + p.edge_room});  // the node says it all
      }
      const LayerRule layer = rule(f, above.below, &upper_ask.below, &lower_ask.above);
      const DoseRange from = doses(above, one ? 0 : edge.slices - 1, rung, in_slit);
      DoseRange to{};
      bool any = back(layer, last, from, to);
      to = common(to, limits);
      any = any && to.lo <= to.hi;
      if (r + 1 == kRungs) {
        if (!any) to = for_features(layer, last, from, limits);
      } else {
        const DoseRange both = common(to, at[r + 1]);
        to = any && both.lo <= both.hi ? both : at[r + 1];
      }
      at[r] = to;
    }
  }
}

void Edges::set_inside(Edge& edge) const {
  const ContinuousPlan& p = plan_;
  const LayerFactors& f = p.of(edge.node);
  const bool upper = !edge.platform && opposite(edge.above_cover, edge.below);
  for (std::size_t r = kRungs; r-- > 0;) {
    const DoseRange limits = inside_of(edge, static_cast<int>(r));
    const bool asks = upper && !p.at_node(edge.height, static_cast<int>(r));
    const EdgeAsk ask = asks ? p.ask(edge.height, f.near[r], false) : EdgeAsk{};
    const LayerRule layer = rule(f, edge.below, &ask.below, nullptr);
    DoseRange to{};
    bool any = back(layer, edge.node, edge.at[r], to);
    to = common(to, limits);
    any = any && to.lo <= to.hi;
    if (r + 1 == kRungs) {
      edge.inside[r] = any ? to : for_features(layer, edge.node, edge.at[r], limits);
    } else {
      const DoseRange both = common(to, edge.inside[r + 1]);
      edge.inside[r] = any && both.lo <= both.hi ? both : edge.inside[r + 1];
    }
  }
  const bool feature = edge.below == kFull, gap = edge.below == 0;
  if (!feature && !gap) return;
  const int last = static_cast<int>(p.grown.size()) - 1;
  if (!edge.platform && p.together > 0 && p.together <= last) {
    const DoseRange there = doses(edge, p.together, 0);
    const double most = std::max(0.0, (there.hi - there.lo) / 4);
    const int slice = edge.node + p.together;
    if (feature) {
      edge.reserved = there.hi - std::min(p.reserve_at(slice, p.feature_reserve), most);
      edge.has_reserve = true;
    } else if (there.lo > p.black_from(slice)) {
      edge.reserved = there.lo + std::min(p.reserve_at(slice, p.gap_reserve), most);
      edge.has_reserve = true;
    }
  }

  // Where slices differ each edge has a place of its own: none is the same as another.
  if (p.uneven()) {
    edge.far = Edge::kNever;
    return;
  }
  // Each of these conditions stays true from some distance on, so that the first such is found by
  // halving.
  const auto first_of = [&](int from, auto holds) {
    int low = from, high = last + 1;
    while (low < high) {
      const int middle = low + (high - low) / 2;
      if (holds(middle)) {
        high = middle;
      } else {
        low = middle + 1;
      }
    }
    return low > last ? Edge::kNever : low;
  };
  const double dark = p.phi_min * p.b;
  const double reached = p.phi_max * p.b + p.a * p.edge_most[kRungs - 1];
  const int near = std::max(p.together, 1);
  const int hidden = first_of(near, [&](int j) {
    for (int r = 0; r < kRungs; ++r) {
      const DoseRange d = doses(edge, j, r);
      if (feature && !(d.lo <= p.prints && d.hi >= std::min(cap(edge, r), reached))) return false;
      if (gap && !(d.lo <= dark && d.hi >= p.open)) return false;
    }
    return true;
  });
  edge.far = hidden == Edge::kNever ? hidden : std::max(hidden + 1, p.together + 2);
  if (gap) {
    edge.dark_from = first_of(near, [&](int j) { return doses(edge, j, 0).lo <= dark; });
  } else if (feature) {
    edge.bright_from = first_of(near, [&](int j) { return doses(edge, j, 0).hi >= p.most; });
    edge.capped_from = first_of(near, [&](int j) { return doses(edge, j, 0).hi >= edge.cap; });
    edge.falls_from = first_of(near, [&](int j) {
      const DoseRange d = doses(edge, j, 0);
      return d.lo <= p.prints && d.hi - p.close >= p.prints;
    });
  }
}

bool Edges::wide(const DoseSet& doses) const {
  return doses.size() == 1 && doses[0].hi - doses[0].lo >= plan_.largest_step;
}

DoseSet Edges::levels_back(const LayerRule& rule, int slice, const DoseSet& above,
                           DoseRange within) const {
  const ContinuousPlan& p = plan_;
  DoseSet found;
  if (above.empty()) return found;
  const LayerFactors& f = p.of(slice);
  const double least = (above.front().lo - f.a * within.hi) * f.per_b;
  const double most = (above.back().hi - f.a * within.lo) * f.per_b;
  const double ratio = p.ratio(slice);
  const int last = p.levels.at_most(most / ratio);
  for (int l = p.levels.at_least(least / ratio); l <= last; ++l) {
    const double phi = ratio * p.levels.phi(l);
    DoseRange limits = within;
    for (int k = 0; k < rule.corners; ++k) {
      const Corner& c = rule.corner[static_cast<std::size_t>(k)];
      if (rule.coverage == kFull) {
        limits.lo = std::max(limits.lo, p.prints * c.grown - phi * c.excess);
      } else {
        limits.hi = std::min(limits.hi, p.open * c.grown - phi * c.excess);
      }
    }
    for (int k = 0; k < rule.opposites; ++k) {
      const Corner& c = rule.opposite[static_cast<std::size_t>(k)];
      if (rule.coverage == kFull) {
        limits.hi = std::min(limits.hi, p.open * c.grown - phi * c.excess);
      } else {
        limits.lo = std::max(limits.lo, p.prints * c.grown - phi * c.excess);
      }
    }
    for (const DoseRange& d : above) {
      const DoseRange w =
          common({(d.lo - phi * f.b) * f.per_a, (d.hi - phi * f.b) * f.per_a}, limits);
      if (w.lo <= w.hi) found.push_back(w);
    }
  }
  std::sort(found.begin(), found.end(), [](auto x, auto y) { return x.lo < y.lo; });
  DoseSet joined;
  for (const DoseRange& d : found) {
    if (!joined.empty() && d.lo <= joined.back().hi + p.slack) {
      joined.back().hi = std::max(joined.back().hi, d.hi);
    } else {
      joined.push_back(d);
    }
  }
  if (joined.size() > kMostIntervals) {
    const auto wider = [](const DoseRange& x, const DoseRange& y) {
      return x.hi - x.lo > y.hi - y.lo || (x.hi - x.lo == y.hi - y.lo && x.lo < y.lo);
    };
    std::nth_element(joined.begin(), joined.begin() + kMostIntervals, joined.end(), wider);
    joined.resize(kMostIntervals);
    std::sort(joined.begin(), joined.end(), [](auto x, auto y) { return x.lo < y.lo; });
  }
  return joined;
}

DoseSet Edges::levels_of(const Edge& edge, int j, bool slit) const {
  if (!edge.has_levels) return {doses(edge, j, kRungs - 1, slit)};
  if (j == 0) return slit ? edge.levels_slit : edge.levels_at;
  const int kept = static_cast<int>(edge.levels_below.size());
  if (j <= kept) return edge.levels_below[static_cast<std::size_t>(j - 1)];
  return {levels_inside(edge, j)};
}

void Edges::set_levels(Edge& edge, const Edge* above) const {
  const ContinuousPlan& p = plan_;
  constexpr std::size_t widest = kRungs - 1;
  const bool one = edge.slices == 1;
  const bool has_slit = edge.above_cover == kFull && edge.below == 0;
  const bool in_slit = above && one && !above->platform && above->below == 0 &&
                       above->above_cover == kFull && edge.below == kFull;
  const double least = 8 * p.largest_step;
  DoseSet from;
  // Between single slices doses have little room on the way down, too.
  const bool singles = above && one && above->slices == 1;
  bool needed = singles || narrower(edge.at[widest], least) || narrower(edge.inside[widest], least);
  if (above && above->has_levels) {
    from = levels_of(*above, one ? 0 : edge.slices - 1, in_slit);
    needed = needed || !wide(from);
  } else if (needed) {
    from = {above ? doses(*above, one ? 0 : edge.slices - 1, static_cast<int>(widest), in_slit)
                  : doses((*this)[edge.above], 0, static_cast<int>(widest))};
  }
  if (!needed || ids_.size() > kMostLevelEdges) return;
  const bool one_upper =
      above && one && !above->platform && opposite(above->above_cover, above->below);
  const LayerFactors &over = p.of(edge.node - 1), &under = p.of(edge.node);
  const SideAsk upper =
      one_upper ? p.ask(above->height, over.near[widest], in_slit).below : SideAsk{};
  const auto at_edge = [&](bool slit) {
    const SideAsk lower = p.ask(edge.height, over.near[widest], slit).above;
    return levels_back(rule(over, edge.above_cover, &upper, &lower), edge.node - 1, from,
                       (slit ? edge.at_slit : edge.at)[widest]);
  };
  edge.levels_at = at_edge(false);
  if (has_slit) edge.levels_slit = at_edge(true);
  if (edge.levels_at.empty() && edge.levels_slit.empty()) return;  // a voxel will be wrong
  const DoseRange limits = inside_of(edge, kRungs - 1);
  const SideAsk own_upper = p.ask(edge.height, under.near[widest], false).below;
  LayerRule layer = rule(under, edge.below, &own_upper, nullptr);
  DoseSet d = edge.levels_at;
  const int last = static_cast<int>(p.grown.size()) - 1;
  for (int j = 1; j <= last; ++j) {
    d = levels_back(layer, edge.node + j - 1, d,
                    j == 1 ? edge.inside[widest] : common(doses(edge, j, kRungs - 1), limits));
    if (d.empty()) break;
    edge.levels_below.push_back(d);
    if (wide(d)) break;
    layer = rule(p.of(edge.node + j), edge.below, nullptr, nullptr);
  }
  if (d.empty() || edge.levels_below.empty()) {
    edge.levels_below.clear();
    edge.levels_inside = edge.inside[widest];
    edge.levels_below.push_back({edge.inside[widest]});
  } else {
    edge.levels_inside = {d.front().lo, d.back().hi};
  }
  edge.has_levels = true;
  const int kept = static_cast<int>(edge.levels_below.size());
  const double dark = p.phi_min * p.b;
  const double reached = p.phi_max * p.b + p.a * p.edge_most[kRungs - 1];
  const auto later = [&](std::int32_t from, auto holds) {
    if (from == Edge::kNever) return from;
    int j = std::max<int>(from, kept + 1);
    while (j <= last && !holds(j, levels_inside(edge, j))) ++j;
    return j <= last ? j : Edge::kNever;
  };
  edge.levels_until = later(std::max(p.together, 1), [&](int j, DoseRange d) {
    const DoseRange aimed = doses(edge, j, 0);
    return d.lo <= aimed.lo && d.hi >= aimed.hi;
  });
  const auto after = [&](std::int32_t& from) {
    if (from != Edge::kNever) from = std::max(from, edge.levels_until);
  };
  after(edge.bright_from);
  after(edge.falls_from);
  after(edge.dark_from);
  edge.far = later(edge.far, [&](int, DoseRange d) {
    return edge.below == kFull
               ? d.lo <= p.prints && d.hi >= std::min(cap(edge, kRungs - 1), reached)
               : d.lo <= dark && d.hi >= p.open;
  });
  if (edge.far != Edge::kNever) ++edge.far;
}

DoseRange Edges::levels_inside(const Edge& edge, int j) const {
  const ContinuousPlan& p = plan_;
  const auto kept = static_cast<int>(edge.levels_below.size());
  const int node = edge.node;
  const double g = p.grown_through(node + kept, j - kept);
  const DoseRange d = edge.levels_inside;
  return common({p.full_from(node + j) - (p.full_from(node + kept) - d.lo) * g,
                 p.black_from(node + j) + (d.hi - p.black_from(node + kept)) * g},
                inside_of(edge, kRungs - 1));
}

bool Edges::levels_allow_kept(const Edge& edge, int j, double dose, bool slit) const {
  const double slack = plan_.slack;
  const auto in = [&](const DoseSet& set) {
    const auto after = std::upper_bound(set.begin(), set.end(), dose + slack,
                                        [](double x, const DoseRange& d) { return x < d.lo; });
    return after != set.begin() && dose <= std::prev(after)->hi + slack;
  };
  if (j == 0) return in(slit ? edge.levels_slit : edge.levels_at);
  const int kept = static_cast<int>(edge.levels_below.size());
  if (j <= kept) return in(edge.levels_below[static_cast<std::size_t>(j - 1)]);
  const DoseRange d = levels_inside(edge, j);
  return dose >= d.lo - slack && dose <= d.hi + slack;
}

}  // namespace slicecorr::detail
