// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "correct/inhibited_rule.hpp"

#include <algorithm>

#include "correct/band_solvers.hpp"

namespace slicecorr::detail {

bool LevelRule::choose_all(bool again) {
  doses_.clear();
  other_light_ = false;
  edge_ = -1;
  by_tables_ = plan_.uniform && caps_.empty() && !doses_.has_floors();
  int first_feature = static_cast<int>(design_.features.size()) - 1;
  int before = 0, same = 0, deep_until = plan_.all_layers;
  const int settled = plan_.tuning.settled_lengths * plan_.near;
  // Slices that no node asks for show their floors, as all do before a level is chosen.
  const int last = doses_.has_floors() ? plan_.all_layers - 1 : last_asked();
  const int first = doses_.has_floors() || design_.features.empty() ? 0 : design_.features[0].upper;
  int begin = last;
  const bool remembers = by_tables_ && !plan_.even && !design_.varies();
  if (remembers) {
    begin = std::min(last, std::max(first_affected(again), first - 1));
    if (begin < last) {
      take_over(last, begin + 1);
      before = doses_.level(begin + 1);
      // Of black slices it does not matter how many there are.
      for (int n = begin + 1; before > 0 && n < plan_.all_layers && doses_.level(n) == before;
           ++n) {
        ++same;
      }
      deep_until = deep_until_[static_cast<std::size_t>(begin + 1)];
    }
    deep_until_.resize(static_cast<std::size_t>(plan_.all_layers));
    std::fill(deep_until_.begin() + last + 1, deep_until_.end(), plan_.all_layers);
  }
  const auto keep_deep = [&](int end, int n) {
    if (!remembers) return;
    std::fill(deep_until_.begin() + end, deep_until_.begin() + n + 1, deep_until);
  };
  for (int n = begin; n >= first; --n) {
    // A settled level stays until the upper edge comes near. But a level that is too dim by itself
    // may stand for long on the light of a burst, and must be looked at all the same.
    if (deep_until < n && same > settled && before >= plan_.holding) {
      if (by_tables_) {
        const int end = std::max(deep_until + 1, first);
        doses_.add_same(n, end);
        keep_deep(end, n);
        n = end;
      } else {
        doses_.add(n, before);
      }
      continue;
    }
    // The features that can ask for light of this slice have nodes above it, within reach.
    while (first_feature >= 0 &&
           design_.features[static_cast<std::size_t>(first_feature)].upper > n) {
      --first_feature;
    }
    if (by_tables_) {
      const Feature& feature = design_.features[static_cast<std::size_t>(first_feature)];
      if (const int end = feature.lower + reach_of(feature) + 1; n >= end) {
        // No node asks for light of these slices.
        before = same = 0;
        deep_until = plan_.all_layers;
        doses_.add_dark(n, end);
        keep_deep(end, n);
        n = end;
        continue;
      }
    }
    if (plan_.even && even_light_fits(n, first_feature)) {
      same = 0;
      before = cap_of(n);
      doses_.add(n, before);
      continue;
    }
    if (by_tables_ && stays(n, first_feature, before)) {
      const Feature& feature = design_.features[static_cast<std::size_t>(first_feature)];
      // Further up other doses may be wanted.
      if (!design_.varies()) deep_until = own_until(feature) + plan_.near;
      keep_deep(n, n);
      ++same;
      doses_.add(n, before);
      continue;
    }
    hint_ = before;
    Slice slice = level_of(n, first_feature, again);
    deep_until = slice.deep_until;
    keep_deep(n, n);
    if (slice.deep && before > 0 && slice.level < before &&
        slice.level >= before - plan_.tuning.calm_levels) {
      slice.level = within(n, before);
    }
    same = slice.level == before ? same + 1 : 1;
    before = slice.level;
    doses_.add(n, slice.level);
  }
  if (last >= 0) doses_.add_dark(first - 1, 0);
  chosen_.features.clear();
  if (remembers) {
    chosen_.levels = doses_.levels();
    chosen_.demand = design_.demand;
    chosen_.features = design_.features;
    chosen_.again = again;
  }
  return other_light_;
}

/// The last slice that may come out otherwise than when levels were chosen last; those after it are
/// asked for the same by the same nodes.
int LevelRule::first_affected(bool again) const {
  const std::vector<Feature>& features = design_.features;
  if (features.empty() || chosen_.features.size() != features.size()) return plan_.all_layers;
  // The last node that asks otherwise, and the farthest slice that it asks.
  int node = -1, reach = 0;
  for (std::size_t f = 0; f < features.size(); ++f) {
    Feature old = chosen_.features[f];
    reach = std::max({reach, reach_of(old), reach_of(features[f])});
    if (old == features[f]) continue;
    old.lag = features[f].lag;
    // Only lags differ from try to try in a column.
    if (!(old == features[f])) return plan_.all_layers;
    node = features[f].lower;
  }
  // The light that nodes before the end of their feature's own light get from others.
  if (again || chosen_.again) node = std::max(node, own_until(features.back()));
  for (int k = features.back().lower; k > node; --k) {
    const auto i = static_cast<std::size_t>(k);
    if (design_.demand[i] != chosen_.demand[i]) node = k;
  }
  return node + reach;
}

/// Shows the levels that were chosen before in slices last .. end.
void LevelRule::take_over(int last, int end) {
  int same = 0;  // slices after n that show its level
  for (int n = last; n >= end;) {
    const Level level = chosen_.levels[static_cast<std::size_t>(n)];
    same = n < last && doses_.level(n + 1) == level ? same + 1 : 0;
    int until = n;
    if (level == 0 || same >= plan_.near) {
      while (until > end && chosen_.levels[static_cast<std::size_t>(until) - 1] == level) --until;
    }
    if (level == 0) {
      doses_.add_dark(n, until);
    } else if (until < n) {
      doses_.add_same(n, until);
    } else {
      doses_.add(n, level);
    }
    same += n - until;
    n = until - 1;
  }
}

/// The last slice that a node asks for.
int LevelRule::last_asked() const {
  int last = -1;
  for (const Feature& f : design_.features) {
    last = std::max(last, f.lower + reach_of(f));
  }
  return std::min(last, plan_.all_layers - 1);
}

/// A feature's nodes first .. last, asked for light of slice n.
struct LevelRule::Asked {
  const Feature& feature;
  int n, own;  ///< `own`: its own light ends here
  int first, last;
  bool again;
};

/// Whether slice n lies deep inside a feature that alone asks for its light, and its least level is the
/// one of the slice before, or so little below it that it stays.
bool LevelRule::stays(int n, int first_feature, int before) const {
  const int less = before - plan_.tuning.calm_levels - 1;
  if (first_feature < 0 || less < 0) return false;
  const Feature& feature = design_.features[static_cast<std::size_t>(first_feature)];
  const int lag = feature.lag, reach = reach_of(feature), own = own_until(feature);
  const int first = std::max(feature.upper, n - reach), nearest = n - lag;
  if (!feature.full || n <= own + plan_.near || n + plan_.near >= feature.lower || first < own ||
      !plan_.promises.hold(n - first, lag)) {
    return false;
  }
  if (first_feature > 0) {
    const Feature& other = design_.features[static_cast<std::size_t>(first_feature) - 1];
    if (other.lower >= n - reach_of(other)) return false;
  }
  const double *const same = plan_.promises.of_level(before), *const dimmer =
                                                                  plan_.promises.of_level(less);
  bool dimmer_does = true;
  for (int k = n; k >= nearest; --k) {
    // A full feature's nodes all have demands.
    const double need = design_.demand[static_cast<std::size_t>(k)] + kMargin - doses_.so_far(k, n);
    if (need > 0 && same[n - k + 1] < need) return false;
    dimmer_does = dimmer_does && !(need > 0 && dimmer[n - k + 1] < need);
  }
  return !dimmer_does && !asks_now(feature, first, nearest, n);
}

/// Whether a node first .. nearest - 1 needs more than slices to come can give.
bool LevelRule::asks_now(const Feature& feature, int first, int nearest, int n) const {
  const int known = n - plan_.near + 1;
  for (const bool within : {true, false}) {
    const int begin = within ? std::max(first, known) : first;
    const int end = within ? nearest : std::min(known, nearest);
    if (begin >= end) continue;
    NodesAsking nodes = doses_.asking(design_.demand, begin, n, within);
    nodes.rest = plan_.promises.rest(feature.lag, n - begin);
    if (last_asking(nodes, static_cast<std::size_t>(end - begin)) > 0) return true;
  }
  return false;
}

/// The least level of slice n with which all nodes that can ask for its light get their doses.
LevelRule::Slice LevelRule::level_of(int n, int first_feature, bool again) {
  Slice slice;
  slice.deep_until = plan_.all_layers;
  const int cap = cap_of(n);
  slice.level = doses_.floor(n);
  for (int f = first_feature; f >= 0; --f) {
    const Feature& feature = design_.features[static_cast<std::size_t>(f)];
    const int reach = reach_of(feature);
    if (feature.lower < n - reach) break;
    const int own = own_until(feature);
    const int begin = std::max(feature.upper, n - reach), end = std::min(feature.lower, n);
    if (feature.full && n > own + plan_.near && n + plan_.near < feature.lower) {
      slice.deep = true;
      if (plan_.uniform && !doses_.has_floors() && !design_.varies() && slice.level == 0)
        slice.deep_until = own + plan_.near;
    }
    Asked by{feature, n, own, begin, end, again};
    if (by_tables_ && slice.level < cap && plan_.promises.hold(n - begin, feature.lag)) {
      // Where the cap is reached, no other node is asked.
      by.first = std::max(begin, own);
      slice.level = level_by_tables(by, slice.level);
      by.first = begin;
      by.last = slice.level < cap ? std::min(end, own - 1) : begin - 1;
    }
    slice.level = level_for_nodes(by, slice.level);
  }
  return slice;
}

/// The least level, at least `level`, with which the nodes get their doses.
int LevelRule::level_for_nodes(const Asked& by, int level) {
  const int n = by.n, cap = cap_of(n);
  for (int k = by.last; k >= by.first; --k) {
    const double wanted = design_.demand[static_cast<std::size_t>(k)];
    if (wanted <= 0) continue;
    const int from = by.feature.platform ? k : std::max(k, by.own);
    double others = 0;
    if (by.again && from > k) {
      others = expected(n, k, from);
      other_light_ = other_light_ || others > 0;
    }
    const double need = wanted + kMargin - doses_.so_far(k, n) - others;
    if (need <= 0) continue;
    level = level_for_node(n, k, from, plan_.lag_from(k, by.feature.lag), need, level);
    if (level >= cap) break;
  }
  return level;
}

/// The same of nodes whose feature's own light goes on up to them, where all slices are alike.
int LevelRule::level_by_tables(const Asked& by, int level) const {
  const int n = by.n, lag = by.feature.lag;
  // Up to the lag: the slice and those to come at its level.
  const int nearest = std::max(by.first, n - lag);
  const double* promise = plan_.promises.of_level(level);
  for (int k = by.last; k >= nearest; --k) {
    const double wanted = design_.demand[static_cast<std::size_t>(k)];
    if (wanted <= 0) continue;
    const double need = wanted + kMargin - doses_.so_far(k, n);
    if (need <= 0 || promise[n - k + 1] >= need) continue;
    level = least_level_above(level, n - k + 1, need, 0);
    promise = plan_.promises.of_level(level);
  }
  // Further away: only what can't come later, from slices that the tables know and from others.
  const int known = n - plan_.near + 1;
  for (const bool within : {true, false}) {
    const int first = within ? std::max(by.first, known) : by.first;
    const int last = std::min(by.last, within ? nearest - 1 : known - 1);
    if (first > last) continue;
    NodesAsking nodes = doses_.asking(design_.demand, first, n, within);
    nodes.rest = plan_.promises.rest(lag, n - first);
    for (auto left = static_cast<std::size_t>(last - first + 1); left > 0;) {
      left = last_asking(nodes, left);
      if (left == 0) break;
      --left;
      const int distance = n - first - static_cast<int>(left);
      const double need = asked_by(nodes, left) - nodes.rest[left];
      if (promise[distance + 1] - promise[distance] >= need) continue;
      level = least_level_above(level, distance + 1, need, distance);
      promise = plan_.promises.of_level(level);
    }
  }
  return level;
}

/// Least level above `level` whose slices from the distance `first` up to `end` give a node `need`; the
/// cap when there is none. Looks near to the level of the slice before.
int LevelRule::least_level_above(int level, int end, double need, int first) const {
  const auto does = [&](int l) {
    const double* const sums = plan_.promises.of_level(l);
    return (first > 0 ? sums[end] - sums[first] : sums[end]) >= need;
  };
  int low = level + 1, high = plan_.caps.front();
  if (low >= high) return high;
  // What does lies at `high` or above, what does not below `low`.
  int at = std::clamp(hint_, low, high);
  if (at == high || does(at)) {
    high = at;
    for (int step = 1; low < high; step *= 4) {
      at = std::max(low, high - step);
      if (!does(at)) {
        low = at + 1;
        break;
      }
      high = at;
    }
  } else {
    low = at + 1;
    for (int step = 1; low < high; step *= 4) {
      at = std::min(high - 1, low + step - 1);
      if (does(at)) {
        high = at;
        break;
      }
      low = at + 1;
    }
  }
  while (low < high) {
    const int l = (low + high) / 2;
    if (does(l)) {
      high = l;
    } else {
      low = l + 1;
    }
  }
  return low;
}

/// Whether slice n lies in a feature that gets even light, and its edge towards the platform takes
/// that light, too: from there on the feature is lit as it would be without flow.
bool LevelRule::even_light_fits(int n, int first_feature) {
  if (first_feature < 0) return false;
  const Feature& feature = design_.features[static_cast<std::size_t>(first_feature)];
  if (!design_.full(n) || n >= feature.lower) return false;
  if (feature.platform) return true;
  const int k = feature.upper;
  if (k != edge_) {
    edge_ = k;
    edge_bears_ = borne_by_edge(feature);
  }
  const double light = plan_.ratio_of(n) * plan_.light_of(n, cap_of(n), n - k);
  return doses_.so_far(k, n) + light <= edge_bears_;
}

/// The dose that the edge of a feature towards the platform gets at least when all nodes after it get
/// theirs: where a slope begins in grey layers, that is more than it demands.
double LevelRule::borne_by_edge(const Feature& feature) const {
  double most = 0, share = 1;
  for (int k = feature.upper; k <= feature.lower && most < share; ++k) {
    most = std::max(most, share * design_.demand[static_cast<std::size_t>(k)]);
    if (design_.full(k)) break;
    share *= plan_.fades.empty() ? plan_.kernel->a() : plan_.far_light.fade(k + 1, k);
  }
  return most;
}

/// The level of slice n, at least `level`, with which node k gets `need` more. Its feature's own
/// light ends at slice `from`. Called for each node of each slice: out of line this and
/// can_still_come() cost a twentieth of the solve.
inline int LevelRule::level_for_node(int n, int k, int from, int lag, double need,
                                     int level) const {
  if (n - k <= lag) {
    if (promised(n, level, k, from) >= need) return level;
    return std::max(level, least_level(n, k, need, from));
  }
  const double can = can_still_come(n, k, from, lag, need);
  if (can >= need) return level;
  return std::max(level, least_level(n, k, need - can, n));
}

/// Dose at node k of slices [k, from), before n, as they were chosen before.
double LevelRule::expected(int n, int k, int from) const {
  double sum = 0;
  for (int i = k; i < std::min(from, n); ++i) {
    const int l = before_[static_cast<std::size_t>(i)];
    if (l) sum += doses_.extra(i, l, i - k);
  }
  return sum;
}

/// Dose at node k from slice n and those in [from, n) at `level`.
double LevelRule::promised(int n, int level, int k, int from) const {
  const ExtraLight& light = plan_.node_light;
  const int start = std::min(std::max(from, k), n);
  if (plan_.uniform && !doses_.has_floors()) return light.sum(0, level, start - k, n - k + 1);
  double sum = 0;
  int end = n + 1;
  if (far_at_once()) {
    sum = plan_.far_light.of_level(level, {k, std::max(start, k + plan_.near), end});
    end = std::min(end, k + plan_.near);
  }
  for (int i = start; i < end; ++i) {
    sum += doses_.has_floors() ? doses_.extra(i, within(i, level), i - k)
                               : plan_.ratio_of(i) * plan_.light_of(i, level, i - k);
  }
  return sum;
}

/// Least level with promised() >= need; the cap when there is none.
int LevelRule::least_level(int n, int k, double need, int from) const {
  int low = doses_.floor(n), high = std::max(low, cap_of(n));
  while (low < high) {
    const int level = (low + high) / 2;
    if (promised(n, level, k, from) >= need) {
      high = level;
    } else {
      low = level + 1;
    }
  }
  return low;
}

/// The most that slices [from, n) can still give node k: full light down to the lag, the steady
/// level after it. Where that is `enough`, anything between the two.
inline double LevelRule::can_still_come(int n, int k, int from, int lag, double enough) const {
  const ExtraLight& light = plan_.node_light;
  double can = 0;
  if (plan_.uniform && caps_.empty() && !doses_.has_floors()) {
    can = light.sum(0, cap_of(n), std::min(n, std::max(from, k + lag)) - k, n - k);
    if (from < k + lag) can += light.sum(0, plan_.steady, from - k, lag);
    return can;
  }
  int end = n;
  if (caps_.empty() && far_at_once()) {
    const int first = std::max(from, k + plan_.near), full = std::max(first, k + lag);
    can = plan_.far_light.of_steady({k, first, std::min(full, n)});
    can += plan_.far_light.of_caps({k, full, n});
    end = std::min(n, k + plan_.near);
  }
  for (int i = from; i < end && can < enough; ++i) {
    const int cap = cap_of(i);
    const int l = i >= k + lag ? cap : std::min(plan_.steady_of(i), cap);
    can += doses_.has_floors() ? doses_.extra(i, within(i, l), i - k)
                               : plan_.ratio_of(i) * plan_.light_of(i, l, i - k);
  }
  return can;
}

}  // namespace slicecorr::detail
