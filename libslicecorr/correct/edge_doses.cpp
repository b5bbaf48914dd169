// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Doses at edges, per rung.
#include <algorithm>

#include "correct/edges.hpp"

namespace slicecorr::detail {

namespace {

/// A shelf (docs/kernels/continuous.md) ends where the falling curve is so many times the dose at the
/// edge. Full light makes it in one slice for each so many above it, else it gains nothing. What goes on
/// below it has so much dose at least.
constexpr double kShelfFall = 1 / 0.15, kBelowShelf = 1.4;
constexpr int kShelfSlices = 5;

}  // namespace

DoseRange Edges::inside_of(const Edge& edge, int rung) const {
  if (edge.below == kFull) return {plan_.prints, cap(edge, rung)};
  if (edge.below == 0) return {0.0, plan_.open};
  return {aim_of(edge.below), plan_.most};
}

DoseRange Edges::doses(const Edge& edge, int j, int rung, bool slit) const {
  const ContinuousPlan& p = plan_;
  if (edge.endless) return inside_of(edge, rung);
  const RungDoses& known = of_rung(edge, rung);
  if (j == 0) return slit ? known.at_slit : known.at;
  const DoseRange base = known.inside;
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
    if (edge.shelf > 0 && j > edge.shelf) {
      const int after = edge.shelf + 1;
      const double fallen = (edge.below_shelf - p.black_from(node + after)) *
                            p.grown_through(node + after, j - after);
      d.hi = std::min(d.hi, black + fallen);
    }
  }
  DoseRange bounds = inside_of(edge, rung);
  if (p.mirrored && edge.below == kFull) bounds.lo = p.prints_at(j);
  return {std::max(d.lo, bounds.lo), std::min(d.hi, bounds.hi)};
}

std::optional<DoseRange> Edges::at_edge(const Edge& edge, const Edge& above, int rung,
                                        bool slit) const {
  const ContinuousPlan& p = plan_;
  const int last = edge.node - 1;  // slice of the run above
  const LayerFactors& f = p.of(last);
  const auto r = static_cast<std::size_t>(rung);
  const bool one = edge.slices == 1;
  const bool one_upper = one && !above.platform && opposite(above.above_cover, above.below);
  const bool in_slit = one_upper && above.below == 0 && edge.below == kFull;
  const bool grey_above = is_grey(above.below);
  DoseRange limits{0.0, p.most};
  if (grey_above) {
    const bool under_full = (one || above.endless) && above.above_cover == kFull && !above.platform;
    limits.lo = grey_least(last, above.below, under_full, edge.below);
  }
  if ((grey_above && edge.below == kFull) || (above.below == kFull && is_grey(edge.below))) {
    limits = {p.prints, p.of(edge.node).grey_edge_most[r]};
  }
  if (above.below == kFull && edge.below == 0) {
    limits.hi = std::min(limits.hi, p.most_at_edge(edge.node, edge.height, rung));
  }
  EdgeAsk upper_ask, lower_ask;
  if (one_upper && (in_slit || !p.at_node(above.height, rung)))
    upper_ask = p.ask(above.height, f.near[r], in_slit);
  if (opposite(above.below, edge.below)) {
    if (slit || !p.at_node(edge.height, rung)) {
      lower_ask = p.ask(edge.height, f.near[r], slit);
    } else {
      limits = common(limits, {p.prints, p.prints + p.edge_room});  // the node says it all
    }
  }
  const LayerRule layer = rule(f, above.below, &upper_ask.below, &lower_ask.above);
  const DoseRange from = doses(above, one ? 0 : edge.slices - 1, rung, in_slit);
  DoseRange to{};
  const bool any = back(layer, last, from, to);
  to = common(to, limits);
  if (any && to.lo <= to.hi) return to;
  if (rung + 1 < kRungs) return std::nullopt;
  return for_features(layer, last, from, limits);
}

std::optional<DoseRange> Edges::at_inside(const Edge& edge, int rung, DoseRange at) const {
  const ContinuousPlan& p = plan_;
  const LayerFactors& f = p.of(edge.node);
  const bool upper = !edge.platform && opposite(edge.above_cover, edge.below);
  const DoseRange limits = inside_of(edge, rung);
  const bool asks = upper && !p.at_node(edge.height, rung);
  const EdgeAsk ask =
      asks ? p.ask(edge.height, f.near[static_cast<std::size_t>(rung)], false) : EdgeAsk{};
  const LayerRule layer = rule(f, edge.below, &ask.below, nullptr);
  DoseRange to{};
  const bool any = back(layer, edge.node, at, to);
  to = common(to, limits);
  if (any && to.lo <= to.hi) return to;
  if (rung + 1 < kRungs) return std::nullopt;
  return for_features(layer, edge.node, at, limits);
}

bool Edges::narrow(const Edge& edge, const Edge& above, int rung, const RungDoses& wider,
                   RungDoses& to) const {
  bool all = true;
  const auto among = [&](const std::optional<DoseRange>& found, DoseRange others) {
    if (found) {
      const DoseRange both = common(*found, others);
      if (both.lo <= both.hi) return both;
    }
    all = false;
    return others;
  };
  to.at = among(at_edge(edge, above, rung, false), wider.at);
  if (above.below == kFull && edge.below == 0)
    to.at_slit = among(at_edge(edge, above, rung, true), wider.at_slit);
  to.inside = among(at_inside(edge, rung, to.at), wider.inside);
  return all;
}

void Edges::set_edge(Edge& edge, const Edge& above) const {
  constexpr int last = kRungs - 1;
  edge.widest.at = *at_edge(edge, above, last, false);
  if (above.below == kFull && edge.below == 0) {
    edge.widest.at_slit = *at_edge(edge, above, last, true);
  }
  edge.widest.inside = *at_inside(edge, last, edge.widest.at);
  if (narrow(edge, above, 0, edge.widest, edge.finest)) return;
  narrow(edge, above, 0, of_rung_between(edge, 1), edge.finest);
}

void Edges::set_edge(Edge& edge, std::span<const DoseRange> at) const {
  edge.widest = {at[kRungs - 1], at[kRungs - 1], *at_inside(edge, kRungs - 1, at[kRungs - 1])};
  RungDoses wider = edge.widest;
  Between between;
  for (int r = kRungs - 1; r-- > 0;) {
    const DoseRange here = at[static_cast<std::size_t>(r)];
    const DoseRange inside = at_inside(edge, r, here).value_or(wider.inside);
    const DoseRange both = common(inside, wider.inside);
    wider = {here, here, both.lo <= both.hi ? both : wider.inside};
    (r > 0 ? between[static_cast<std::size_t>(r) - 1] : edge.finest) = wider;
  }
  edge.between = static_cast<std::int32_t>(between_.size());
  between_.push_back(between);
}

const RungDoses& Edges::of_rung_between(const Edge& edge, int rung) const {
  if (edge.between == Edge::kNone) set_between(edge);
  return between_[static_cast<std::size_t>(edge.between)][static_cast<std::size_t>(rung) - 1];
}

void Edges::set_between(const Edge& edge) const {
  // Those of the edges above come first: there may be many, so this does not call itself.
  std::vector<const Edge*> lacking;
  for (const Edge* e = &edge; !e->endless && e->between == Edge::kNone; e = &(*this)[e->above]) {
    lacking.push_back(e);
  }
  for (; !lacking.empty(); lacking.pop_back()) {
    const Edge& e = *lacking.back();
    Between between;
    RungDoses wider = e.widest;
    for (int r = kRungs - 2; r > 0; --r) {
      RungDoses& to = between[static_cast<std::size_t>(r) - 1];
      narrow(e, (*this)[e.above], r, wider, to);
      wider = to;
    }
    e.between = static_cast<std::int32_t>(between_.size());
    between_.push_back(between);
  }
}

void Edges::set_shelf(Edge& edge) const {
  const ContinuousPlan& p = plan_;
  const int last = static_cast<int>(p.grown.size()) - 1;
  int top = p.together + 1;  // the node up to which the dose falls in black
  while (top < last && p.grown_through(edge.node, top) < kShelfFall) ++top;
  if (top >= last) return;
  const double most = doses(edge, top, 0).hi;
  if (most >= edge.cap) return;
  // So many slices of full light lead from what goes on below the shelf to the falling curve.
  int slices = 0;
  double dose = kBelowShelf;
  for (; dose < most; ++slices) {
    if (slices * kShelfSlices >= top || top + slices >= last) return;
    const int slice = edge.node + top + slices;
    dose = p.of(slice).step(p.ratio(slice) * p.phi_max, dose);
  }
  const DoseRange below = doses(edge, top + slices, 0);
  if (slices == 0 || kBelowShelf <= below.lo || kBelowShelf >= below.hi) return;
  // The falling curve further down is one that prints with the level next to black, too.
  if (kBelowShelf - p.close < p.prints) return;
  edge.shelf = top + slices - 1;
  edge.below_shelf = kBelowShelf;
}

void Edges::set_inside(Edge& edge) const {
  const ContinuousPlan& p = plan_;
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

  if (feature && edge.has_reserve && shelves_) set_shelf(edge);

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
  const int far = std::max(near, edge.shelf + 1);  // where doses only rise
  const int hidden = first_of(far, [&](int j) {
    // Doses of the rungs between are among those of the last, and have those of rung 0 among them.
    for (const int r : {0, kRungs - 1}) {
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
    edge.bright_from = first_of(far, [&](int j) { return doses(edge, j, 0).hi >= p.most; });
    edge.capped_from = first_of(far, [&](int j) { return doses(edge, j, 0).hi >= edge.cap; });
    edge.falls_from = first_of(near, [&](int j) {
      const DoseRange d = doses(edge, j, 0);
      return d.lo <= p.prints && d.hi - p.close >= p.prints;
    });
  }
}

}  // namespace slicecorr::detail
