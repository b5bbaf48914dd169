// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// What a plan knows of layers that are not alike: of different heights, or below a platform that sends light back.

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>

#include "correct/inhibited_plan.hpp"

namespace slicecorr::detail {

namespace {

/// So far from the platform that nothing comes back.
constexpr double kFarUm = 1e9;

}  // namespace

int InhibitedPlan::longest(int lag) const {
  if (kernel->heights().alike()) return lag;
  const std::vector<double>& um = kernel->heights().um();
  const double thinnest = *std::min_element(um.begin(), um.end());
  return std::max(lag, static_cast<int>(std::ceil(lag * layer_um / thinnest)));
}

/// Slices of a level that lift the dose from 0 to 1 where all layers are so high.
int InhibitedPlan::reach_at(double height_um, int level) const {
  if (!kernel->layer_by_layer()) {
    return static_cast<int>(std::ceil(reach * layer_um / height_um));
  }
  const int setting = kernel->strongest_setting();
  const double lit = kernel->source(setting, level).amount,
               dark = kernel->source(setting, 0).amount;
  // Beyond its tables' reach light only fades: what has not come after some of it never does.
  const int most = static_cast<int>(std::ceil(20.0 * near * layer_um / height_um));
  double dose = 0;
  int slices = 1;
  for (; slices < most; ++slices) {
    const double um = slices * height_um;
    dose += lit * kernel->rate(setting, level, um) - dark * kernel->rate(setting, 0, um);
    if (dose >= 1.0) break;
  }
  return slices;
}

int InhibitedPlan::steady_at(double height_um) const {
  const int setting = kernel->strongest_setting();
  int level = caps[static_cast<std::size_t>(setting)];
  while (level > 0 && kernel->steady_dose_at(setting, level - 1, {height_um, kFarUm}) >= 1.0)
    --level;
  return level;
}

double InhibitedPlan::ripple_at(double height_um) const {
  constexpr int samples = InhibitedKernel::kSamples;
  const int setting = kernel->strongest_setting(), level = steady_at(height_um);
  double least = std::numeric_limits<double>::infinity(), at_node = 0;
  for (int i = 1; i <= samples; ++i) {
    at_node = kernel->steady_dose_at(setting, level,
                                     {height_um, kFarUm, static_cast<double>(i) / samples});
    least = std::min(least, at_node);
  }
  return least > 0 ? at_node / least : 1.0;
}

void InhibitedPlan::find_own_layers() {
  const InhibitedKernel& k = *kernel;
  constexpr int samples = InhibitedKernel::kSamples;
  for (int n = 0; n <= all_layers; ++n) {
    const double um = k.height_um(n);
    const LayerFade& its =
        fades.emplace_back(LayerFade{k.fade(um), k.fade(0.5 * (um + k.height_um(n + 1))),
                                     k.returned(k.place_um(n)), k.returned(k.place_um(n + 0.5))});
    middle_times.push_back(its.middle * its.middle_back);
    for (int i = 0; i < samples && k.layer_by_layer(); ++i) {
      const double t = static_cast<double>(i + 1) / samples;
      sample_fades.push_back(
          static_cast<float>(k.fade(um * (t - 1)) * k.returned(k.place_um(n + 1 - t))));
    }
  }
  if (k.heights().alike()) return;
  const int longest_lag = std::max(end_lag, *std::max_element(lags.begin(), lags.end()));
  for (int lag = 0; lag <= longest_lag; ++lag) {
    int end = 0;
    for (int node = 0; node <= all_layers; ++node) {
      end = std::max(end, node);
      // The node nearest to where the lag ends.
      while (k.place_um(end + 0.5) - k.place_um(node) < lag * layer_um) ++end;
      lags_from.push_back(std::max(std::min(lag, 1), end - node));
    }
  }
  if (!k.layer_by_layer()) return;
  std::map<double, std::pair<double, int>> known;
  for (int n = 0; n <= all_layers; ++n) {
    const double um = k.height_um(n);
    const auto [entry, is_new] = known.try_emplace(um);
    if (is_new) entry->second = {tuning.inside_dose * ripple_at(um), steady_at(um)};
    insides.push_back(entry->second.first);
    steadies.push_back(entry->second.second);
  }
}

}  // namespace slicecorr::detail
