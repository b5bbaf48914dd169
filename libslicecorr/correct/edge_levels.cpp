// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Doses at edges for which levels exist, where rungs are so narrow that these matter.
#include <algorithm>

#include "correct/edges.hpp"

namespace slicecorr::detail {

namespace {

/// Most intervals of doses that are kept per node; of more the widest are kept.
constexpr std::size_t kMostIntervals = 4096;
/// Most edges of a band for which sets of doses for levels are worked out: a part whose columns are
/// noise would take for ever otherwise.
constexpr std::size_t kMostLevelEdges = 8000;

bool narrower(DoseRange d, double width) { return d.hi - d.lo < width; }

}  // namespace

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

DoseSet Edges::levels_at(const Edge& edge, int j, bool slit) const {
  if (!edge.has_levels()) return {doses(edge, j, kRungs - 1, slit)};
  const EdgeLevels& levels = levels_of(edge);
  if (j == 0) return slit ? levels.at_slit : levels.at;
  const int kept = static_cast<int>(levels.below.size());
  if (j <= kept) return levels.below[static_cast<std::size_t>(j - 1)];
  return {levels_inside(edge, j)};
}

void Edges::set_levels(Edge& edge, const Edge* above) {
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
  bool needed = singles || narrower(edge.widest.at, least) || narrower(edge.widest.inside, least);
  if (above && above->has_levels()) {
    from = levels_at(*above, one ? 0 : edge.slices - 1, in_slit);
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
  const auto of_levels = [&](bool slit) {
    const SideAsk lower = p.ask(edge.height, over.near[widest], slit).above;
    return levels_back(rule(over, edge.above_cover, &upper, &lower), edge.node - 1, from,
                       slit ? edge.widest.at_slit : edge.widest.at);
  };
  EdgeLevels levels;
  levels.at = of_levels(false);
  if (has_slit) levels.at_slit = of_levels(true);
  if (levels.at.empty() && levels.at_slit.empty()) return;  // a voxel will be wrong
  const DoseRange limits = inside_of(edge, kRungs - 1);
  const SideAsk own_upper = p.ask(edge.height, under.near[widest], false).below;
  LayerRule layer = rule(under, edge.below, &own_upper, nullptr);
  DoseSet d = levels.at;
  const int last = static_cast<int>(p.grown.size()) - 1;
  for (int j = 1; j <= last; ++j) {
    d = levels_back(layer, edge.node + j - 1, d,
                    j == 1 ? edge.widest.inside : common(doses(edge, j, kRungs - 1), limits));
    if (d.empty()) break;
    levels.below.push_back(d);
    if (wide(d)) break;
    layer = rule(p.of(edge.node + j), edge.below, nullptr, nullptr);
  }
  if (d.empty() || levels.below.empty()) {
    levels.below.clear();
    levels.inside = edge.widest.inside;
    levels.below.push_back({edge.widest.inside});
  } else {
    levels.inside = {d.front().lo, d.back().hi};
  }
  edge.levels = static_cast<std::int32_t>(levels_.size());
  levels_.push_back(levels);
  const int kept = static_cast<int>(levels.below.size());
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
  const EdgeLevels& levels = levels_of(edge);
  const auto kept = static_cast<int>(levels.below.size());
  const int node = edge.node;
  const double g = p.grown_through(node + kept, j - kept);
  const DoseRange d = levels.inside;
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
  const EdgeLevels& levels = levels_of(edge);
  if (j == 0) return in(slit ? levels.at_slit : levels.at);
  const int kept = static_cast<int>(levels.below.size());
  if (j <= kept) return in(levels.below[static_cast<std::size_t>(j - 1)]);
  const DoseRange d = levels_inside(edge, j);
  return dose >= d.lo - slack && dose <= d.hi + slack;
}

}  // namespace slicecorr::detail
