// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "correct/layer_level.hpp"

#include <algorithm>
#include <cmath>

#include "correct/coverage.hpp"
#include "cure/margin.hpp"

namespace slicecorr::detail {

int level_to_node(const LayerLight& light, double edge) {
  const LevelTable& levels = light.plan.levels;
  const double a = light.plan.model.a_of(light.slice), returned = light.returned(0);
  const auto reached = [&](int level) { return light.near(level) * a * returned; };
  if (reached(0) >= edge) return 0;
  int level = levels.at_least(light.phi(edge / a / returned));
  // Solving for phi rounds differently from stepping forward: what counts is the dose delivered.
  while (level < levels.highest() && reached(level) < edge) {
    level = levels.at_least(std::nextafter(levels.phi(level), 1e308));
  }
  return level;
}

namespace {

/// The level whose print ends nearest to the edge height of the layer's upper node, while the middle
/// of the layer prints, and that of the layer above, a gap's, does not. Black light makes the gap's
/// dose jump up at the node: where the layer stays liquid at its node, so must the gap.
int level_to_height(const LayerLight& light) {
  const LevelTable& levels = light.plan.levels;
  const CureModel& model = light.plan.model;
  const double per_slice = -std::log(model.a);
  const double at_node = light.returned(0), at_middle = light.returned(0.5);
  const double above = light.returned(-0.5);
  struct End {
    int wrong;
    double off;
    // clang-tidy 14 takes its comparison with 0 for one with a null pointer.
    auto operator<=>(const End&) const = default;  // NOLINT(modernize-use-nullptr)
  };
  const auto end = [&](int level) {
    const double node = light.near(level) * model.a, in_gap = node + light.dark;
    const bool ends = node * at_node < 1.0;
    const bool slit = ends && in_gap * at_node >= 1.0;
    const bool prints = light.near(level) * model.root_a * at_middle >= 1.0 + kMargin;
    const bool open = in_gap * model.root_a * above < 1.0;
    const double below = -std::log((ends ? node : in_gap) * at_node) / per_slice;
    return End{(prints ? 0 : 2) + (open ? 0 : 1) + (slit ? 1 : 0),
               std::abs(below - edge_height_slices(light.height))};
  };
  const double phi = light.phi(light.wanted());
  const double most = std::nextafter(1.0 / at_node - light.dark, 0.0);
  const int clear = levels.at_most(light.phi(most / model.a));
  int best = level_to_node(light, 1.0 + kMargin);
  for (const int level : {levels.at_least(phi), levels.at_most(phi), clear}) {
    if (end(level) < end(best)) best = level;
  }
  return best;
}

}  // namespace

int layer_level(const LayerLight& light, std::uint8_t coverage) {
  if (coverage == 0) return 0;
  const LevelTable& levels = light.plan.levels;
  const CureModel& model = light.plan.model;
  if (coverage == kFull) {
    return light.ends_at_node() ? level_to_node(light, 1.0 + kMargin) : level_to_height(light);
  }
  const double returned = light.returned(0.5), root_a = model.root_a_of(light.slice);
  const auto middle = [&](int level) { return light.near(level) * root_a * returned; };
  const double aim = aim_of(coverage);
  const double phi = light.phi(aim / root_a / returned);
  int level = levels.at_most(phi);
  const int next = levels.at_least(phi);
  if (next > level && middle(next) < 1.0 && middle(next) - aim < aim - middle(level)) level = next;
  return level;
}

}  // namespace slicecorr::detail
