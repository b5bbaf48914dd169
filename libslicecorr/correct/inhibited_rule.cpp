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
  int first_feature = static_cast<int>(design_.features.size()) - 1;
  int before = 0, same = 0, deep_until = plan_.all_layers;
  const int settled = plan_.tuning.settled_lengths * plan_.near;
  for (int n = plan_.all_layers; n-- > 0;) {
    // A settled level stays until the upper edge comes near. But a level that is too dim by itself
    // may stand for long on the light of a burst, and must be looked at all the same.
    if (deep_until < n && same > settled && before >= plan_.holding) {
      doses_.add(n, before);
      continue;
    }
    // The features that can ask for light of this slice have nodes above it, within reach.
    while (first_feature >= 0 &&
           design_.features[static_cast<std::size_t>(first_feature)].upper > n) {
      --first_feature;
    }
    if (plan_.even && even_light_fits(n, first_feature)) {
      same = 0;
      before = cap_of(n);
      doses_.add(n, before);
      continue;
    }
    Slice slice = level_of(n, first_feature, again);
    deep_until = slice.deep_until;
    if (slice.deep && before > 0 && slice.level < before &&
        slice.level >= before - plan_.tuning.calm_levels) {
      slice.level = within(n, before);
    }
    same = slice.level == before ? same + 1 : 1;
    before = slice.level;
    doses_.add(n, slice.level);
  }
  return other_light_;
}

/// The least level of slice n with which all nodes that can ask for its light get their doses.
LevelRule::Slice LevelRule::level_of(int n, int first_feature, bool again) {
  Slice slice;
  slice.deep_until = plan_.all_layers;
  const int cap = cap_of(n);
  slice.level = doses_.floor(n);
  for (int f = first_feature; f >= 0; --f) {
    const Feature& feature = design_.features[static_cast<std::size_t>(f)];
    const int reach = plan_.reach + feature.lag + plan_.tuning.spare_slices;
    if (feature.lower < n - reach) break;
    // The feature's own light ends here: slices nearer to the platform are black, or light others.
    const int own = feature.platform ? 0 : feature.upper + feature.lag;
    const int begin = std::max(feature.upper, n - reach), end = std::min(feature.lower, n);
    if (feature.full && n > own + plan_.near && n + plan_.near < feature.lower) {
      slice.deep = true;
      if (plan_.uniform && !doses_.has_floors() && slice.level == 0)
        slice.deep_until = own + plan_.near;
    }
    for (int k = end; k >= begin; --k) {
      const double wanted = design_.demand[static_cast<std::size_t>(k)];
      if (wanted <= 0) continue;
      const int from = feature.platform ? k : std::max(k, own);
      double others = 0;
      if (again && from > k) {
        others = expected(n, k, from);
        other_light_ = other_light_ || others > 0;
      }
      const double need = wanted + kMargin - doses_.so_far(k, n) - others;
      if (need <= 0) continue;
      slice.level = level_for_node(n, k, from, feature.lag, need, slice.level);
      if (slice.level >= cap) break;
    }
  }
  return slice;
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
  const double light =
      plan_.ratio_of(n) * plan_.node_light.one(plan_.setting_of(n), cap_of(n), n - k);
  return doses_.so_far(k, n) + light <= edge_bears_;
}

/// The dose that the edge of a feature towards the platform gets at least when all nodes after it get
/// theirs: where a slope begins in grey layers, that is more than it demands.
double LevelRule::borne_by_edge(const Feature& feature) const {
  double most = 0, share = 1;
  for (int k = feature.upper; k <= feature.lower && most < share; ++k) {
    most = std::max(most, share * design_.demand[static_cast<std::size_t>(k)]);
    if (design_.full(k)) break;
    share *= plan_.kernel->a();
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
  const double can = can_still_come(n, k, from, lag);
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
  for (int i = start; i <= n; ++i) {
    sum += doses_.has_floors() ? doses_.extra(i, within(i, level), i - k)
                               : plan_.ratio_of(i) * light.one(plan_.setting_of(i), level, i - k);
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
/// level after it.
inline double LevelRule::can_still_come(int n, int k, int from, int lag) const {
  const ExtraLight& light = plan_.node_light;
  double can = 0;
  if (plan_.uniform && caps_.empty() && !doses_.has_floors()) {
    can = light.sum(0, cap_of(n), std::min(n, std::max(from, k + lag)) - k, n - k);
    if (from < k + lag) can += light.sum(0, plan_.steady, from - k, lag);
    return can;
  }
  for (int i = from; i < n; ++i) {
    const int cap = cap_of(i);
    const int l = i >= k + lag ? cap : std::min(plan_.steady, cap);
    can += doses_.has_floors() ? doses_.extra(i, within(i, l), i - k)
                               : plan_.ratio_of(i) * light.one(plan_.setting_of(i), l, i - k);
  }
  return can;
}

}  // namespace slicecorr::detail
