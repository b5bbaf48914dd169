// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "correct/level_search.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>

namespace slicecorr::detail {

namespace {

/// Edges further up than this are not chosen together with the slice at hand.
constexpr int kFarthestSlices = 40;
/// Levels that the search in depth looks at before it gives up.
constexpr int kLooks = 200;
/// Survivors per node, at most one in each of `kCells` parts of its range of doses; levels that are
/// tried from all survivors of the node before together, and from each of them at least.
constexpr int kCells = 128, kTries = 1024, kLeastTries = 16;
/// Tolerances that differ by less than this factor count as equally good.
constexpr double kSameTolerance = 1.2;

}  // namespace

RunAt run_above(const Edges& edges, const RunAt& run) {
  const Edge& edge = edges[run.edge];
  const bool slit = edge.below == 0 && run.lower - run.node == 1 && run.below == kFull &&
                    edge.above_cover == kFull;
  return {edge.above, run.node - edge.slices, run.node, edge.below, slit, edge.height};
}

LevelSearch::LevelSearch(const Edges& edges) : edges_(edges), plan_(edges.plan()) {}

LevelSearch::LightRule LevelSearch::light_rule(const LayerFactors& layer, const LayerRule& rule,
                                               DoseRange target) const {
  const ContinuousPlan& p = plan_;
  const Bound least{(target.lo - p.slack) * layer.per_b, layer.a * layer.per_b};
  const Bound most{(target.hi + p.slack) * layer.per_b, layer.a * layer.per_b};
  LightRule light;
  light.feature = rule.coverage == kFull;
  light.own = light.feature ? most : least;
  light.others.fill(light.feature ? least : most);
  const double dose = light.feature ? p.prints - 0.5 * p.slack : p.open + 0.5 * p.slack;
  for (std::size_t k = 0; k < static_cast<std::size_t>(rule.corners); ++k) {
    const Corner& c = rule.corner[k];
    light.others[k + 1] = {dose * c.grown * c.per_excess, c.per_excess};
  }
  const double beyond = light.feature ? p.open + 0.5 * p.slack : p.prints - 0.5 * p.slack;
  light.opposites = rule.opposites;
  for (std::size_t k = 0; k < static_cast<std::size_t>(rule.opposites); ++k) {
    const Corner& c = rule.opposite[k];
    light.opposite[k] = {beyond * c.grown * c.per_excess, c.per_excess};
  }
  return light;
}

LevelSearch::LevelRange LevelSearch::levels(const LightRule& rule, double below, double ratio,
                                            double taken) const {
  const Light l = of_levels(rule, below, ratio, taken);
  if (l.least > l.most || l.most < plan_.phi_min || l.least > plan_.phi_max) return {1, 0};
  const int first = plan_.levels.at_least(l.least);
  if (plan_.levels.phi(first) > l.most) return {1, 0};
  return {first, plan_.levels.at_most(l.most)};
}

bool LevelSearch::any_level(const LightRule& rule, double below, double ratio, double taken) const {
  const Light l = of_levels(rule, below, ratio, taken);
  if (l.least > l.most || l.most < plan_.phi_min || l.least > plan_.phi_max) return false;
  return plan_.levels.phi(plan_.levels.at_least(l.least)) <= l.most;
}

LayerRule LevelSearch::rule_of(const RunAt& run, int n, int rung) const {
  const Edge& edge = edges_[run.edge];
  const bool upper = n == run.node && !edge.platform && opposite(edge.above_cover, edge.below);
  const bool lower = n == run.lower - 1 && opposite(edge.below, run.below);
  const LayerFactors& f = plan_.of(n);
  if (!upper && !lower) return edges_.rule(f, edge.below, nullptr, nullptr);
  const EdgeCorners& near = f.near[static_cast<std::size_t>(rung)];
  const bool slit = edge.below == 0 && run.lower - run.node == 1;
  SideAsk at_upper, at_lower;
  if (upper && !plan_.at_node(edge.height, rung)) {
    at_upper = plan_.ask(edge.height, near, slit).below;
  }
  if (lower && (run.slit_below || !plan_.at_node(run.lower_height, rung))) {
    at_lower = plan_.ask(run.lower_height, near, run.slit_below).above;
  }
  return edges_.rule(f, edge.below, &at_upper, &at_lower);
}

double LevelSearch::grey_aim(const RunAt& run, int n, double below) const {
  const Edge& edge = edges_[run.edge];
  const bool first = n == run.node;
  const std::uint8_t above = edges_.cover_above(run.edge);
  if (first && !edge.platform && above == kFull) return 1.0;
  const double own = aim_of(edge.below);
  const double other = !first ? own : edge.platform ? 0.0 : aim_of(above);
  const double root_a = plan_.of(n).root_a;
  double aim = (1.0 + root_a) * own - root_a * below;
  aim = std::min(aim, std::max(own, other));
  return other > 0 ? std::max(aim, std::min(own, other)) : aim;
}

int LevelSearch::one_slice(const RunAt& run, int n, double below) const {
  const ContinuousPlan& p = plan_;
  const Edge& edge = edges_[run.edge];
  const LayerFactors& f = p.of(n);
  const int j = n - run.node;
  const double ratio = p.ratio(n);
  // The commonest cases first: full light does not exceed the doses allowed yet, or black suffices.
  if (j >= p.together && j > 0 && j >= edge.levels_until) {
    if (edge.below == kFull && n + 1 != run.lower &&
        ratio * p.phi_max * f.b + f.a * below <= edges_.doses(edge, j, 0).hi) {
      return p.levels.size() - 1;
    }
    if (edge.below == 0 && !(n + 1 == run.lower && run.ends_inside()) &&
        ratio * p.phi_min * f.b + f.a * below >= edges_.doses(edge, j, 0).lo) {
      return 0;
    }
  }
  if (j == 0 && edge.below == kFull && !edge.platform && is_grey(edge.above_cover)) {
    // Only as much light as this layer needs itself, because the layer above is grey.
    const LayerRule rule = rule_of(run, n, kRungs - 1);
    return p.levels.at_least(light_rule(f, rule, {p.prints, p.most}).at(below).least / ratio);
  }
  const bool slit = j == 0 && edge.below == 0 && run.lower - run.node == 1 && run.below == kFull &&
                    edge.above_cover == kFull && !edge.platform;
  const auto allowed = [&](int level) {
    return edges_.levels_allow(edge, j, f.step(ratio * p.levels.phi(level), below), slit);
  };
  if (is_grey(edge.below)) {
    // The level nearest to the dose aimed at, among those that leave enough for the layers above.
    const double least = (edges_.grey_least_at(run.edge, j) - f.a * below) * f.per_b / ratio;
    const double aim = (grey_aim(run, n, below) - f.a * below) * f.per_b / ratio;
    if (aim <= least) return p.levels.at_least(least);
    const LevelTable::Around around = p.levels.around(aim);
    const bool next = p.levels.phi(around.at_least) - aim < aim - p.levels.phi(around.at_most);
    const int nearest = next ? around.at_least : around.at_most;
    return p.levels.phi(nearest) < least ? p.levels.at_least(least) : nearest;
  }
  for (int r = 0; r < kRungs; ++r) {
    const LevelRange range =
        levels(light_rule(f, rule_of(run, n, r), edges_.doses(edge, j, r, slit)), below, ratio);
    if (range.empty()) continue;
    if (edge.below == 0) {
      for (int l = range.first; l <= range.last; ++l) {
        if (allowed(l)) return l;
      }
    } else {
      for (int l = range.last; l >= range.first; --l) {
        if (allowed(l)) return l;
      }
    }
  }
  // Some voxel will be wrong. Voxels of features come first: a gap gets the light that the features
  // above it need.
  const LayerRule rule = rule_of(run, n, kRungs - 1);
  const DoseRange target = edges_.doses(edge, j, kRungs - 1, slit);
  if (edge.has_levels() && edge.below == 0) {
    LayerRule none;
    const LevelRange range = levels(light_rule(f, none, target), below, ratio);
    for (int l = range.first; l <= range.last; ++l) {
      if (allowed(l)) return l;
    }
  }
  return p.levels.at_least(light_rule(f, rule, target).at(below).least / ratio);
}

double LevelSearch::exact(const RunAt& run, int n, double below) const {
  const ContinuousPlan& p = plan_;
  const Edge& edge = edges_[run.edge];
  const LayerFactors& f = p.of(n);
  const int j = n - run.node;
  const double black = p.ratio(n) * p.phi_min, full = p.ratio(n) * p.phi_max;
  const bool slit = j == 0 && edge.below == 0 && run.lower - run.node == 1 && run.below == kFull &&
                    edge.above_cover == kFull && !edge.platform;
  Light l{};
  for (int r = 0; r < kRungs; ++r) {
    l = light_rule(f, rule_of(run, n, r), edges_.doses(edge, j, r, slit)).at(below);
    if (l.least <= l.most && l.most >= black && l.least <= full) break;
  }
  // Leave out the slack, which is kept for rounding.
  l.least += p.slack * f.per_b;
  l.most -= p.slack * f.per_b;
  double phi = edge.below == 0 ? l.least : l.most;
  if (is_grey(edge.below)) {
    phi = std::max(grey_aim(run, n, below), edges_.grey_least_at(run.edge, j)) * f.per_b -
          f.a * below * f.per_b;
  }
  return std::clamp(phi, black, full);
}

bool LevelSearch::is_edge(std::int32_t id) const {
  const Edge& edge = edges_[id];
  return !edge.platform && !edge.endless && opposite(edge.above_cover, edge.below);
}

int LevelSearch::gather(const RunAt& start, int n) {
  top_ = n;
  const Edge* edge = &edges_[start.edge];
  // Find the last edge whose slices are chosen together with these.
  int last = start.node;
  cut_ = false;
  while (edge->slices > 0 && edge->slices <= plan_.together + 1) {
    const Edge& above = edges_[edge->above];
    if (above.platform || !opposite(above.above_cover, above.below)) break;
    if (n - (last - edge->slices) > kFarthestSlices) {
      cut_ = true;
      break;
    }
    last -= edge->slices;
    edge = &above;
  }
  const int end = last - 1;
  RunAt run = start;
  count_ = 0;
  for (int s = n; s >= end; --s) {
    if (s < run.node) run = run_above(edges_, run);
    const Edge& e = edges_[run.edge];
    SearchStep& step = steps_[static_cast<std::size_t>(count_++)];
    step.edge = run.edge;
    step.j = s - run.node;
    step.ratio = plan_.ratio(s);
    step.layer = &plan_.of(s);
    step.coverage = e.below;
    step.upper = s == run.node && !e.platform && opposite(e.above_cover, e.below);
    step.lower = s == run.lower - 1 && opposite(e.below, run.below);
    step.slit_below = run.slit_below;
    step.slit = s == run.node && e.below == 0 && run.lower - run.node == 1 && run.below == kFull &&
                e.above_cover == kFull;
    step.upper_height = e.height;
    step.lower_height = run.lower_height;
    // The true length of an endless run is not known.
    if (e.endless) run.node = std::min(run.node, s);
  }
  first_edge_ = n - start.node + 1;
  return count_;
}

bool LevelSearch::inside_feature(const SearchStep& s) const {
  // Of endless runs it is not known how far above their end lies.
  return s.coverage == kFull && (s.j > 0 || edges_[s.edge].endless);
}

bool LevelSearch::hold_below(SearchStep& s, int k) const {
  if (!inside_feature(s)) return true;
  s.target.hi = std::min(s.target.hi, std::max(most_[top_ - k], plan_.prints) + room_);
  return s.target.lo <= s.target.hi;
}

bool LevelSearch::aim(double tolerance) { return aim(plan_.corners_of(plan_, tolerance)); }

bool LevelSearch::aim(const EdgeCorners& usual) {
  const ContinuousPlan& p = plan_;
  const double tolerance = usual.tolerance;
  EdgeCorners own;
  for (int k = count_; k-- > 0;) {
    SearchStep& s = steps_[static_cast<std::size_t>(k)];
    // Layers of other heights have corners of their own.
    const bool other = s.layer != &plan_ && (s.upper || s.lower);
    if (other) own = p.corners_of(*s.layer, tolerance);
    const EdgeCorners& at = other ? own : usual;
    const EdgeAsk upper = s.upper ? p.ask(s.upper_height, at, s.slit) : EdgeAsk{};
    const EdgeAsk lower =
        s.lower ? p.ask(s.lower_height, at, s.slit_below && s.coverage == kFull) : EdgeAsk{};
    s.rule = edges_.rule(*s.layer, s.coverage, &upper.below, &lower.above);
    const Edge& edge = edges_[s.edge];
    if (k + 1 == count_) {
      // Under a grey layer a level step must fit, as it is given where no edge is near.
      int rung = !edge.platform && is_grey(edges_.cover_above(s.edge)) && s.coverage == kFull
                     ? p.grey_rung
                     : 0;
      if (cut_) {
        rung = 1;
        while (rung + 1 < kRungs && p.tolerance[static_cast<std::size_t>(rung)] < tolerance) ++rung;
      }
      s.target = edges_.doses(edge, s.j, rung);
      if (most_ && !hold_below(s, k)) return false;
      s.light = light_rule(*s.layer, s.rule, s.target);
      continue;
    }
    const SearchStep& above = steps_[static_cast<std::size_t>(k + 1)];
    if (!edges_.back(above.rule, top_ - (k + 1), above.target, s.target)) return false;
    if (s.j > 0) {
      const DoseRange limits =
          s.coverage == kFull
              ? DoseRange{p.prints_at(s.j), edges_.cap(edge, tolerance < kWidest ? 0 : kRungs - 1)}
              : DoseRange{0.0, p.open};
      s.target.lo = std::max(s.target.lo, limits.lo);
      s.target.hi = std::min(s.target.hi, limits.hi);
      if (s.target.lo > s.target.hi) return false;
      if (most_ && !hold_below(s, k)) return false;
    }
    s.light = light_rule(*s.layer, s.rule, s.target);
  }
  return true;
}

template <class AnyStep>
bool LevelSearch::depth_first(const AnyStep* steps, double below, std::uint8_t* out) const {
  const LevelTable& table = plan_.levels;
  double dose[kMost + 1];
  Light range[kMost];
  int at[kMost];
  int looks = 0;
  int k = 0;
  dose[0] = below;
  // Gaps take their levels from the darkest up, features from the brightest down: the other end of the
  // range is asked for where it is come to.
  const auto enter = [&](int depth) {
    const AnyStep& s = steps[depth];
    Light& l = range[depth];
    l = of_levels(s.light, dose[depth], s.ratio, taken_at(depth));
    if (l.least > l.most || l.most < plan_.phi_min || l.least > plan_.phi_max) {
      at[depth] = -1;
    } else {
      at[depth] = s.coverage == 0 ? table.at_least(l.least) : table.at_most(l.most);
    }
  };
  const auto in_range = [&](int depth) {
    if (at[depth] < 0 || at[depth] >= table.size()) return false;
    const double phi = table.phi(at[depth]);
    return phi >= range[depth].least && phi <= range[depth].most;
  };
  enter(0);
  while (k >= 0) {
    const AnyStep& s = steps[k];
    if (!in_range(k)) {
      if (--k < 0) return false;
      at[k] += steps[k].coverage == 0 ? 1 : -1;
      continue;
    }
    if (++looks > kLooks) return false;
    dose[k + 1] = after(s, k, at[k], dose[k]);
    if (!edges_.levels_allow(edges_[s.edge], s.j, dose[k + 1], s.slit)) {
      at[k] += s.coverage == 0 ? 1 : -1;
      continue;
    }
    if (k + 1 == count_) {
      for (int i = 0; i < count_; ++i) out[i] = static_cast<std::uint8_t>(at[i]);
      return true;
    }
    enter(++k);
  }
  return false;
}

bool LevelSearch::survivors(double below, std::uint8_t* out) {
  kept_.assign(1, {below, -1, 0});
  begin_.assign(1, 0);
  for (int k = 0; k < count_; ++k) {
    const SearchStep& s = steps_[static_cast<std::size_t>(k)];
    const Edge& edge = edges_[s.edge];
    const auto first = static_cast<std::size_t>(begin_.back());
    const std::size_t last = kept_.size();
    const int tries = std::max(kLeastTries, kTries / static_cast<int>(last - first));
    begin_.push_back(static_cast<std::int32_t>(last));
    std::uint64_t taken[kCells / 64] = {};
    int left = kCells;
    const double per_cell = kCells / std::max(s.target.hi - s.target.lo, 1e-300);
    for (std::size_t i = first; i < last; ++i) {
      const double w = kept_[i].dose;
      const LevelRange range = levels(s.light, w, s.ratio, taken_at(k));
      if (range.empty()) continue;
      const int all = range.last - range.first + 1;
      const int shown = std::min(all, tries);
      for (int t = 0; t < shown; ++t) {
        const int up = shown == all ? t
                                    : static_cast<int>(static_cast<std::int64_t>(t) * (all - 1) /
                                                       std::max(1, shown - 1));
        const int level = s.coverage == 0 ? range.first + up : range.last - up;
        const double dose = after(s, k, level, w);
        const int cell =
            std::clamp(static_cast<int>((dose - s.target.lo) * per_cell), 0, kCells - 1);
        if (taken[cell / 64] >> (cell % 64) & 1) continue;
        if (!edges_.levels_allow(edge, s.j, dose, s.slit)) continue;
        if (k + 1 < count_) {
          const SearchStep& next = steps_[static_cast<std::size_t>(k + 1)];
          if (!any_level(next.light, dose, next.ratio, taken_at(k + 1))) continue;
        }
        taken[cell / 64] |= std::uint64_t{1} << (cell % 64);
        --left;
        kept_.push_back({dose, static_cast<std::int32_t>(i), static_cast<std::uint8_t>(level)});
        if (k + 1 == count_) break;
      }
      if (left == 0 || (k + 1 == count_ && kept_.size() > last)) break;
    }
    if (kept_.size() == last) return false;
  }
  std::size_t i = static_cast<std::size_t>(begin_.back());
  for (int k = count_; k-- > 0;) {
    out[k] = kept_[i].level;
    i = static_cast<std::size_t>(kept_[i].before);
  }
  return true;
}

bool LevelSearch::search(double below, std::uint8_t* levels, std::size_t from) {
  const ContinuousPlan& p = plan_;
  for (std::size_t t = from; t < p.ladder.size(); t += 2) {
    if (!aim(p.ladder[t]) || !depth_first(steps_.data(), below, levels)) continue;
    std::uint8_t better[kMost];
    if (t > 0 && aim(p.ladder[t - 1]) && depth_first(steps_.data(), below, better)) {
      std::memcpy(levels, better, static_cast<std::size_t>(count_));
    }
    return true;
  }
  if (aim(kWidest) && survivors(below, levels)) {
    double good = kWidest, bad = p.tolerance[0];
    std::uint8_t better[kMost];
    while (good > bad * kSameTolerance) {
      const double middle = std::sqrt(good * bad);
      if (aim(middle) && survivors(below, better)) {
        good = middle;
        std::memcpy(levels, better, static_cast<std::size_t>(count_));
      } else {
        bad = middle;
      }
    }
    return true;
  }
  return false;
}

const LevelSearch::LevelStep* LevelSearch::prepared(const RunAt& run, int n) {
  const auto id = static_cast<std::size_t>(run.edge);
  const auto steps = static_cast<std::size_t>(plan_.together) + 1;
  const std::size_t piece = 256 * steps;
  if (id >= prepared_of_.size()) prepared_of_.resize(id + 1, kNotYet);
  std::int32_t& place = prepared_of_[id];
  if (place == kNotYet) {
    place = kUnusual;
    if (gather(run, n) == plan_.together + 1 && !cut_ && aim(plan_.ladder[0])) {
      if (prepared_.empty() || prepared_.back().size() == piece) {
        prepared_.emplace_back().reserve(piece);
      }
      place =
          static_cast<std::int32_t>(256 * (prepared_.size() - 1) + prepared_.back().size() / steps);
      prepared_.back().insert(prepared_.back().end(), steps_.begin(), steps_.begin() + count_);
    }
  }
  if (place == kUnusual) return nullptr;
  const auto at = static_cast<std::size_t>(place);
  return &prepared_[at / 256][at % 256 * steps];
}

int LevelSearch::choose(const RunAt& run, int n, double below, std::uint8_t* levels,
                        const double* taken) {
  const int j = n - run.node;
  taken_ = taken;
  // Of one slice, as if its dose had been less before it.
  const double told = taken ? below - taken[0] * plan_.b * plan_.per_a : below;
  if (!looks_ahead(run, n)) {
    levels[0] = static_cast<std::uint8_t>(one_slice(run, n, told));
    return 1;
  }
  // All columns with the same edge have the same above it; of what lies below, only whether the
  // run ends with this slice, and on what, counts.
  const bool bottom = n + 1 == run.lower;
  const auto first = static_cast<std::uint8_t>(
      !bottom ? 0 : 1 | run.slit_below << 1 | (run.below == kFull) << 2 | (run.below == 0) << 3);
  const std::uint8_t height = bottom ? run.lower_height : kEdgeAtNode;
  const auto bits = std::bit_cast<std::uint64_t>(below);
  const std::uint64_t mixed =
      (bits ^ static_cast<std::uint64_t>(run.edge) << 32 ^ static_cast<std::uint64_t>(j)) *
      0x9E3779B97F4A7C15ULL;
  Known& known = known_[static_cast<std::size_t>(mixed >> 40) % known_.size()];
  if (!taken && known.edge == run.edge && known.j == j && known.bits == bits &&
      known.first == first && known.height == height) {
    std::memcpy(levels, known.levels, known.count);
    return known.count;
  }
  int chosen = 0;
  bool found = false;
  std::size_t tried = 0;
  if (j + 1 == plan_.together && !bottom) {
    if (const LevelStep* const usual = prepared(run, n)) {
      count_ = chosen = plan_.together + 1;
      found = depth_first(usual, below, levels);
      tried = 2;
    }
  }
  if (!found) {
    gather(run, n);
    chosen = cut_ ? first_edge_ : count_;
    if (!search(below, levels, tried)) {
      levels[0] = static_cast<std::uint8_t>(one_slice(run, n, told));
      return 1;
    }
  }
  if (!taken && chosen <= Known::kSlices) {
    known = {bits, run.edge, j, first, height, static_cast<std::uint8_t>(chosen), {}};
    std::memcpy(known.levels, levels, static_cast<std::size_t>(chosen));
  }
  return chosen;
}

int LevelSearch::one_slice_near(const RunAt& run, int n, double below, const Wanted& wanted) const {
  const ContinuousPlan& p = plan_;
  const Edge& edge = edges_[run.edge];
  const LayerFactors& f = p.of(n);
  const int j = n - run.node;
  const bool under_grey = j == 0 && !edge.platform && is_grey(edge.above_cover);
  if (edge.below != kFull || under_grey) return one_slice(run, n, below);
  const double ratio = p.ratio(n), phi = wanted.phi / ratio;
  const LevelTable::Around around = p.levels.around(phi);
  const bool next = p.levels.phi(around.at_least) - phi < phi - p.levels.phi(around.at_most);
  const bool up = wanted.side == DoseSide::at_least || (wanted.side == DoseSide::nearest && next);
  const int nearest = up ? around.at_least : around.at_most;
  for (int r = 0; r < kRungs; ++r) {
    const LevelRange range =
        levels(light_rule(f, rule_of(run, n, r), edges_.doses(edge, j, r)), below, ratio);
    if (range.empty()) continue;
    const int from = std::clamp(nearest, range.first, range.last);
    for (int off = 0; off <= range.last - range.first; ++off) {
      for (const int level : {up ? from + off : from - off, up ? from - off : from + off}) {
        if (level < range.first || level > range.last) continue;
        if (edges_.levels_allow(edge, j, f.step(ratio * p.levels.phi(level), below))) return level;
      }
    }
  }
  return one_slice(run, n, below);
}

bool LevelSearch::search_below(double below, const Wanted& wanted, double room,
                               std::uint8_t* levels) {
  // An edge that is where it should comes before a dose that is: of tolerances only the finest.
  constexpr std::size_t most = 6;
  most_ = wanted.most;
  room_ = room;
  bool found = false;
  for (std::size_t t = 0; t <= most && t < plan_.ladder.size() && !found; t += 2) {
    found = aim(plan_.ladder[t]) && depth_first(steps_.data(), below, levels);
  }
  most_ = nullptr;
  return found;
}

int LevelSearch::choose_near(const RunAt& run, int n, double below, const Wanted& wanted,
                             std::uint8_t* levels, const double* taken) {
  taken_ = taken;
  if (!looks_ahead(run, n)) {
    const double told = taken ? below - taken[0] * plan_.b * plan_.per_a : below;
    levels[0] = static_cast<std::uint8_t>(one_slice_near(run, n, told, wanted));
    return 1;
  }
  gather(run, n);
  bool held = false;
  for (int k = 0; k < count_ && !held; ++k) {
    const SearchStep& s = steps_[static_cast<std::size_t>(k)];
    held = inside_feature(s) && wanted.most[n - k] < edges_.doses(edges_[s.edge], s.j, 0).hi;
  }
  if (held) {
    const int chosen = cut_ ? first_edge_ : count_;
    for (const double room : {wanted.room, wanted.room + plan_.feature_reserve,
                              wanted.room + 4 * plan_.feature_reserve}) {
      if (search_below(below, wanted, room, levels)) return chosen;
    }
  }
  return choose(run, n, below, levels, taken);
}

}  // namespace slicecorr::detail
