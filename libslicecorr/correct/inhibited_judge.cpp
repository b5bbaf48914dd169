// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "correct/inhibited_judge.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <limits>

#include "slicecorr/dose.hpp"

namespace slicecorr::detail {

ColumnJudge::Score ColumnJudge::score(double most_um) {
  const InhibitedTuning& t = plan_.tuning;
  Score s;
  dips_.clear();
  for (const ColumnDesign::Edge& edge : design_.edges) {
    const double um = edge_error_um(edge);
    if (um > (edge.below == 0 ? t.tolerance_um : t.height_tolerance_um)) s.perfect = false;
    s.um += std::min(um, t.most_edge_layers * plan_.layer_um);
  }
  count_wrong_voxels(s);
  // Looking through features takes most of the time: not for levels that are worse already.
  if (s.um >= most_um) {
    s.um = std::numeric_limits<double>::infinity();
    return s;
  }
  look_through(s, most_um);
  if (s.um >= most_um) s.um = std::numeric_limits<double>::infinity();
  return s;
}

void ColumnJudge::count_wrong_voxels(Score& s) const {
  const InhibitedTuning& t = plan_.tuning;
  int end = std::min(plan_.layers + plan_.reach, plan_.all_layers);
  // Beyond the last light and the last feature nothing prints, and nothing is to.
  if (!doses_.has_floors() && plan_.most_dark < 1.0) {
    end = std::min(end, std::max(doses_.last_lit(), design_.last_node) + 1);
  }
  constexpr int at_once = 64;
  for (int first = 0; first < end; first += at_once) {
    const int past = std::min(first + at_once, end);
    if (count_wrong(design_.coverage_from(first), doses_.middles(first),
                    static_cast<std::size_t>(past - first)) == 0) {
      continue;
    }
    for (int n = first; n < past; ++n) {
      // Grey layers count neither as right nor as wrong.
      const int c = design_.coverage(n);
      if ((c != 0 && c != 255) || design_.left_alone(n)) continue;
      if ((doses_.middle(n) >= 1.0) == (c == 255)) continue;
      // What others fill the column can't help.
      if (c == 0 && doses_.has_floors() && doses_.floor_middle(n) >= 1.0) continue;
      s.perfect = false;
      ++s.wrong_voxels;
      s.um += (c == 255 ? t.lost_voxel_layers : t.grown_voxel_layers) * plan_.layer_um;
    }
  }
}

/// Distance of the printed edge from the designed one, um, by straight lines between nodes and
/// middles. Infinite when there is none within the distance at which errors stop to count.
double ColumnJudge::edge_error_um(const ColumnDesign::Edge& edge) const {
  // In half layers: 2k is node k, 2k + 1 the middle of layer k.
  const int end = 2 * plan_.all_layers;
  const auto dose = [&](int h) {
    if (h % 2) return doses_.middle(h / 2);
    return h / 2 < plan_.all_layers ? doses_.node(h / 2) : 0.0;
  };
  const double start = 2 * (edge.node + edge.below);
  double value = doses_.beside(edge.node, edge.below);
  const bool printed = value >= 1.0;
  // Printed at the edge: follow it into the gap; else look for print inside the feature.
  const int step = printed == edge.upper ? -1 : 1;
  double at = start, passed_um = 0;
  // Lengths are those of the layer in which they lie.
  const auto half_um = [&](double from, double to) {
    const int layer = static_cast<int>(std::floor(0.25 * (from + to)));
    return std::abs(to - from) * 0.5 * plan_.kernel->height_um(layer);
  };
  int h = static_cast<int>(step > 0 ? std::floor(start) + 1 : std::ceil(start) - 1);
  for (; h >= 0 && h <= end; h += step) {
    const double passed = std::abs(at - start);
    if (passed > 2 * plan_.tuning.most_edge_layers) break;
    const double next = dose(h);
    if ((next >= 1.0) != printed) {
      const double t = (1.0 - value) / (next - value);
      return plan_.lags_from.empty() ? (passed + t * std::abs(h - at)) * 0.5 * plan_.layer_um
                                     : passed_um + t * half_um(at, h);
    }
    // Stop where the gap or the feature that is searched ends.
    const int layer = (h + (step > 0 ? 0 : -1)) / 2;
    if (h % 2 == 0 && layer >= 0 && layer < plan_.layers) {
      if ((design_.coverage(layer) != 0) == printed) break;
    }
    value = next;
    passed_um += half_um(at, h);
    at = h;
  }
  return std::numeric_limits<double>::infinity();
}

/// Finds the dips of all features; see Prediction::split_features.
void ColumnJudge::look_through(Score& s, double most_um) {
  const InhibitedTuning& t = plan_.tuning;
  dips_.clear();
  run_first_ = -1;
  if (floor_.exists()) keep_what_stays();
  for (int n = std::min(design_.last_node, plan_.layers); n-- > 0;) {
    if (!design_.full(n)) continue;
    const std::size_t before = dips_.size();
    look_through_feature(n);
    for (std::size_t i = before; i < dips_.size(); ++i) {
      const double depth = t.split_depth_layers * (1.0 - dips_[i].least);
      s.um += (t.split_layers + std::min(t.most_split_depth_layers, depth)) * plan_.layer_um;
    }
    if (s.um >= most_um) return;
  }
}

/// Finds the dips of the full layers from `layer` up to the next that is not full, and leaves that
/// one in `layer`.
void ColumnJudge::look_through_feature(int& layer) {
  bool any = false, printed = false;
  Dip dip{layer, 1.0};
  const auto turn = [&](bool prints) {
    if (prints == printed) return;
    printed = prints;
    if (!prints) return;
    if (any && dip.least < 1.0 - kSameDose) dips_.push_back(dip);
    any = true;
    dip.least = 1.0;
  };
  for (; design_.full(layer); --layer) {
    look_inside(layer);
    // From the layer's lower end up: each crossing turns print on or off.
    bool prints = (doses_.node(layer) >= 1.0) == (inside_.crossings.size() % 2 == 0);
    turn(prints);
    for (std::size_t i = 0; i <= inside_.crossings.size(); ++i) {
      if (inside_.least < dip.least && (i == 0 || !printed)) dip = {layer, inside_.least};
      if (i == inside_.crossings.size()) break;
      prints = !prints;
      turn(prints);
    }
  }
}

/// Where what is known of layer k's levels stands; `wanted` gets these.
ColumnJudge::Window& ColumnJudge::window_of(int k, Window& wanted) {
  std::memcpy(wanted.levels, doses_.levels().data() + k, static_cast<std::size_t>(plan_.near));
  const std::uint64_t mixed =
      (wanted.levels[0] * 0x9E3779B97F4A7C15ULL ^ wanted.levels[1]) * 0xD6E8FEB86659FD93ULL;
  return safe_[static_cast<std::size_t>(mixed >> 40U) % kSafe];
}

/// Forgets what was found of layers whose near slices show other levels than those that were judged last.
void ColumnJudge::keep_what_stays() {
  constexpr double unknown = std::numeric_limits<double>::infinity();
  const auto& levels = doses_.levels();
  if (judged_.size() != levels.size()) {
    above_with_.assign(levels.size(), unknown);
  } else {
    auto changed = levels.size() + static_cast<std::size_t>(plan_.near);
    for (std::size_t n = levels.size(); n-- > 0;) {
      if (levels[n] != judged_[n]) changed = n;
      if (changed < n + static_cast<std::size_t>(plan_.near)) above_with_[n] = unknown;
    }
  }
  judged_.assign(levels.begin(), levels.end());
}

/// Whether it is sure by the doses at its ends and in its middle alone that all of layer k is above 1.
bool ColumnJudge::all_above_1(int k, double lower) {
  const double beyond = doses_.floor_far(k) + doses_.far(k);
  double& with = above_with_[static_cast<std::size_t>(k)];
  if (beyond >= with) return true;
  const int past = std::min(plan_.near, plan_.all_layers - k);
  floor_.begin();
  for (int j = 0; j < past; ++j) {
    floor_.add(j, j, plan_.setting_of(k + j), doses_.level(k + j), plan_.ratio_of(k + j));
  }
  if (floor_.least({lower, doses_.middle(k), doses_.node(k)}) < 1.0) return false;
  if (!doses_.has_floors()) with = beyond;
  return true;
}

/// Finds the least dose inside layer k of a feature, and where it crosses 1.
void ColumnJudge::look_inside(int k) {
  const double above = doses_.node(k), half = doses_.middle(k), below = doses_.node(k + 1);
  const InhibitedKernel& kernel = *plan_.kernel;
  const bool steps = kernel.layer_by_layer();
  inside_.crossings.clear();
  inside_.least = std::min({below, half, above});
  if (!steps && SmoothBounds(below, half, above).low >= 1.0) return;
  // The layer's own slice adds nothing at the window, unless resin cures there.
  const int level = doses_.level(k);
  const bool cures =
      steps && (kernel.source(plan_.setting_of(k), level).front_um <= 0 || !kernel.alike());
  const double own = cures ? plan_.ratio_of(k) * kernel.added(k, level, k + 1.0) : 0.0;
  if (inside_.least >= 1.0 && floor_.exists() && all_above_1(k, below + own)) return;
  const int end = std::min(k + plan_.near, plan_.all_layers);
  const double beyond = (doses_.floor_far(k) + doses_.far(k)) / plan_.node_fade(k);
  // Where all near slices show one level, the layer's least dose follows from that level alone.
  if (run_first_ != k + 1 || doses_.level(run_first_) != level) {
    for (run_end_ = k + 1; run_end_ < end && doses_.level(run_end_) == level;) ++run_end_;
  }
  run_first_ = k;
  const bool same = plan_.uniform && inside_.least >= 1.0 && run_end_ >= k + plan_.near;
  if (same && layer_.steady_above({k, 0, level, 1.0}, beyond, 0.0)) return;
  Window wanted;
  Window* safe = nullptr;
  if (!safe_.empty() && inside_.least >= 1.0 && end == k + plan_.near) {
    safe = &window_of(k, wanted);
    if (safe->levels[0] == wanted.levels[0] && safe->levels[1] == wanted.levels[1] &&
        beyond >= safe->beyond) {
      return;
    }
  }
  layer_.begin(beyond, k);
  for (int n = k; n < end;) {
    int past = n + 1;
    if (plan_.uniform) {
      while (past < end && doses_.level(past) == doses_.level(n)) ++past;
    }
    layer_.add(n - k, past - 1 - k, plan_.setting_of(n), doses_.level(n), plan_.ratio_of(n));
    n = past;
  }
  layer_.sample(below + own, half, above);
  layer_.find(0.0, inside_);
  if (safe && inside_.crossings.empty() && inside_.least >= 1.0) {
    wanted.beyond = beyond;
    *safe = wanted;
  }
}

}  // namespace slicecorr::detail
