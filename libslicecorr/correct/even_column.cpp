// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "correct/even_column.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>

namespace slicecorr::detail {

namespace {

/// Absorbance heights beyond the tables within which slices are summed one by one; what is further
/// away, a twentieth of an edge's light and less, is summed as if it were all of one level.
constexpr double kFarHeights = 3;
/// Layers of a slope whose greys are looked at.
constexpr int kSlopeLayers = 40;

}  // namespace

EvenColumn::EvenColumn(const InhibitedPlan& plan)
    : plan_(plan),
      more_(static_cast<std::size_t>(plan.all_layers) + 2, 0.0),
      levels_(static_cast<std::size_t>(plan.all_layers)) {
  const double a = plan.kernel->a();
  // Of the thinnest layers there are more.
  double thinnest_um = plan.layer_um;
  for (const double um : plan.kernel->heights().um()) thinnest_um = std::min(thinnest_um, um);
  far_ = plan.near +
         static_cast<int>(std::ceil(kFarHeights / -std::log(a) * (plan.layer_um / thinnest_um)));
  powers_.push_back(1);
  while (static_cast<int>(powers_.size()) <= plan.all_layers + 1)
    powers_.push_back(powers_.back() * a);
  const int setting = plan.kernel->strongest_setting();
  int level = 0;
  for (int c = 0; c < 256; ++c) {
    while (level + 1 < plan.levels && plan.kernel->steady_dose(setting, level) < c / 255.0) ++level;
    grey_[static_cast<std::size_t>(c)] = static_cast<Level>(level);
  }
}

double EvenColumn::one(int n, int level, int distance) const {
  if (!plan_.fades.empty()) return plan_.ratio_of(n) * plan_.light_of(n, level, distance);
  const ExtraLight& light = plan_.node_light;
  const int s = plan_.setting_of(n), last = plan_.near - 1;
  if (distance <= last) return plan_.ratio_of(n) * light.close(s, level, distance);
  return plan_.ratio_of(n) * light.close(s, level, last) *
         powers_[static_cast<std::size_t>(distance - last)];
}

/// What is left at node `to` of a dose at node `from`, which lies further from the platform, or nearer: then all.
double EvenColumn::fade(int from, int to) const {
  if (from <= to) return 1;
  return plan_.fades.empty() ? powers_[static_cast<std::size_t>(from - to)]
                             : plan_.far_light.fade(from, to);
}

/// The least level of slice n that gives `need` to a node so far from it, or even light.
int EvenColumn::least_level(int n, int distance, double need) const {
  int low = 0, high = even_at(n);
  while (low < high) {
    const int level = (low + high) / 2;
    if (one(n, level, distance) >= need) {
      high = level;
    } else {
      low = level + 1;
    }
  }
  return low;
}

/// The first node that demands dose, and what it gets at least when all that follow get theirs.
EvenColumn::Edge EvenColumn::edge_of(Run first, Run past) const {
  if (first->coverage == 255) {
    return {first->first, std::max(0.0, 1 + more_[static_cast<std::size_t>(first->first)])};
  }
  Edge edge{first->first + 1, 0};
  int node = edge.node, above = first->coverage;
  for (Run run = first; run != past && node <= edge.node + kSlopeLayers;) {
    if (node >= run->end && ++run == past) break;
    const int below = run->coverage;
    const bool whole = above == 255 || below == 255;
    const double demand = whole ? 1.0 : std::min(above, below) / 255.0;
    edge.limit = std::max(edge.limit, demand * fade(node, edge.node));
    if (whole) break;
    above = below;
    ++node;
  }
  return edge;
}

/// Lights slices from `end` on until the node there has what it needs; returns the slice after them.
int EvenColumn::light_after(int end, double need) {
  int n = end;
  for (; n < plan_.all_layers && need > 0; ++n) {
    const int level = even_at(n);
    const double light = one(n, level, n - end);
    Level& shown = levels_[static_cast<std::size_t>(n)];
    shown =
        std::max(shown, static_cast<Level>(light < need ? level : least_level(n, n - end, need)));
    need -= light;
  }
  return n;
}

void EvenColumn::light_feature(Run first, Run past) {
  Run last_full = past;
  while (last_full != first && std::prev(last_full)->coverage != 255) --last_full;
  const auto shine = [&](int n, int level) {
    levels_[static_cast<std::size_t>(n)] = static_cast<Level>(level);
  };
  if (last_full == first) {
    // Grey all along, as where a wall runs through the pixel.
    int least = 255;
    for (Run run = first; run != past; ++run) {
      least = std::min<int>(least, run->coverage);
      for (int n = run->first; n < run->end; ++n) {
        shine(n, std::min<int>(grey_[run->coverage], even_at(n)));
      }
    }
    later_node_ = first->first;
    later_dose_ = least / 255.0;
    return;
  }
  const int end = std::prev(last_full)->end;
  // What a feature after gives its own edge falls on the way to this one's end.
  double from_later = 0;
  if (later_dose_ > 0) {
    from_later = later_dose_ * fade(later_node_, end);
  }
  const int past_light = light_after(end, 1 + more_[static_cast<std::size_t>(end)] - from_later);
  const Edge edge = edge_of(first, past);
  const bool platform = first->first == 0;
  double dose = 0;
  if (later_dose_ > 0) {
    dose = later_dose_ * fade(later_node_, edge.node);
  }
  for (int n = past_light - 1; n >= end; --n) {
    dose += one(n, levels_[static_cast<std::size_t>(n)], n - edge.node);
  }
  const int summed = std::min(end, edge.node + far_);
  if (end > summed && !plan_.fades.empty()) {
    dose += plan_.far_light.of_level(even_at(summed), {edge.node, summed, end});
  } else if (end > summed) {
    const double a = plan_.kernel->a();
    const auto count = static_cast<std::size_t>(end - summed);
    dose += one(summed, even_at(summed), summed - edge.node) * (1 - powers_[count]) / (1 - a);
  }
  for (Run run = last_full; run != first;) {
    --run;
    for (int n = run->end - 1; n >= std::max(run->first, edge.node); --n) {
      int level = even_at(n);
      if (run->coverage != 255) level = std::min<int>(level, grey_[run->coverage]);
      if (!platform && n < summed) {
        const double light = one(n, level, n - edge.node);
        if (dose + light > edge.limit) {
          if (dose < edge.limit) shine(n, least_level(n, n - edge.node, edge.limit - dose));
          later_node_ = edge.node;
          later_dose_ = std::max(dose, edge.limit);
          return;
        }
        dose += light;
      }
      shine(n, level);
    }
  }
  later_node_ = edge.node;
  later_dose_ = dose;
}

const std::vector<Level>& EvenColumn::levels(const std::vector<CoverageRun>& runs,
                                             const std::vector<Level>& even) {
  even_ = &even;
  std::fill(more_.begin(), more_.end(), 0.0);
  return levels_again(runs);
}

const std::vector<Level>& EvenColumn::levels_again(const std::vector<CoverageRun>& runs) {
  std::fill(levels_.begin(), levels_.end(), Level{0});
  later_node_ = 0;
  later_dose_ = 0;
  for (Run past = runs.end(); past != runs.begin();) {
    Run first = std::prev(past);
    while (first != runs.begin() && std::prev(first)->end == first->first) --first;
    light_feature(first, past);
    past = first;
  }
  return levels_;
}

}  // namespace slicecorr::detail
