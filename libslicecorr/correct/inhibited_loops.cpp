// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "correct/inhibited_loops.hpp"

#include <algorithm>

#include "base/kernels.hpp"

namespace slicecorr::detail {

namespace {

SLICECORR_CLONES
void add_light(const ChangedLight& light, double* node, double* middle) {
  const double* __restrict const to_node = light.to_node;
  const double* __restrict const to_middle = light.to_middle;
  const double times = light.times;
  constexpr std::size_t lanes = 8;
  for (std::size_t b = 0; b < light.reach; b += lanes) {
    for (std::size_t i = b; i < b + lanes; ++i) node[i] += times * to_node[i];
    for (std::size_t i = b; i < b + lanes; ++i) middle[i] += times * to_middle[i];
  }
}

SLICECORR_CLONES
void exchange_light(const ChangedLight& light, double* node, double* middle) {
  const double* __restrict const from_node = light.from_node;
  const double* __restrict const from_middle = light.from_middle;
  const double* __restrict const to_node = light.to_node;
  const double* __restrict const to_middle = light.to_middle;
  const double times = light.times;
  constexpr std::size_t lanes = 8;
  for (std::size_t b = 0; b < light.reach; b += lanes) {
    for (std::size_t i = b; i < b + lanes; ++i) {
      node[i] += times * (to_node[i] - from_node[i]);
    }
    for (std::size_t i = b; i < b + lanes; ++i) {
      middle[i] += times * (to_middle[i] - from_middle[i]);
    }
  }
}

}  // namespace

void change_light(const ChangedLight& light, double* node, double* middle) {
  (light.from_node ? exchange_light : add_light)(light, node, middle);
}

SLICECORR_CLONES
void change_samples(const ChangedSamples& light, float* last) {
  constexpr std::size_t samples = 16;
  const float times = light.times;
  for (std::size_t j = 0; j < light.rows; ++j) {
    const float* __restrict const to = light.to + j * samples;
    const float* __restrict const from = light.from + j * samples;
    float* __restrict const out = last - j * samples;
    for (std::size_t i = 0; i < samples; ++i) out[i] += times * (to[i] - from[i]);
  }
}

namespace {

SLICECORR_CLONES
std::int64_t count_asking_near(const NodesAsking& nodes, std::size_t count) {
  const double* __restrict const demand = nodes.demand;
  const double* __restrict const dark = nodes.dark;
  const double* __restrict const added = nodes.added;
  const double* __restrict const far = nodes.far;
  const double* __restrict const rest = nodes.rest;
  const double margin = nodes.margin, times = nodes.far_times;
  std::int64_t asking = 0;
  for (std::size_t i = 0; i < count; ++i) {
    const double need = demand[i] + margin - (dark[i] + added[i] + times * far[i]);
    asking += static_cast<std::int64_t>(demand[i] > 0) & static_cast<std::int64_t>(need > rest[i]);
  }
  return asking;
}

SLICECORR_CLONES
std::int64_t count_asking_far(const NodesAsking& nodes, std::size_t count) {
  const double* __restrict const demand = nodes.demand;
  const double* __restrict const dark = nodes.dark;
  const double* __restrict const powers = nodes.powers;
  const double* __restrict const rest = nodes.rest;
  const double margin = nodes.margin, times = nodes.far_times;
  std::int64_t asking = 0;
  for (std::size_t i = 0; i < count; ++i) {
    const double need = demand[i] + margin - (dark[i] + times * powers[i]);
    asking += static_cast<std::int64_t>(demand[i] > 0) & static_cast<std::int64_t>(need > rest[i]);
  }
  return asking;
}

}  // namespace

std::size_t last_asking(const NodesAsking& nodes, std::size_t count) {
  if (count == 0) return 0;
  const std::int64_t asking =
      nodes.powers ? count_asking_far(nodes, count) : count_asking_near(nodes, count);
  if (asking == 0) return 0;
  while (!(nodes.demand[count - 1] > 0 && asked_by(nodes, count - 1) > nodes.rest[count - 1])) {
    --count;
  }
  return count;
}

namespace {

/// Layers of their own are few, or change what their slices show at every step: no loop is compiled for them.
double dose_at(const MiddleDoses& doses, std::size_t i) {
  return doses.dark[i] + doses.added[i] + doses.times(i) * doses.far[i];
}

std::int64_t count_wrong_of_own(const std::uint8_t* coverage, const MiddleDoses& doses,
                                std::size_t count) {
  std::int64_t wrong = 0;
  for (std::size_t i = 0; i < count; ++i) {
    const bool prints = dose_at(doses, i) >= 1.0;
    wrong += (coverage[i] == 255 && !prints) || (coverage[i] == 0 && prints) ? 1 : 0;
  }
  return wrong;
}

double cost_of(std::uint8_t coverage, double m, const LayerCosts& c) {
  const double lacks = std::max(0.0, c.core_dose - m), excess = std::max(0.0, m - c.excess_dose),
               over = std::max(0.0, m - c.gap_dose);
  const double full = c.core_weight * lacks * lacks + c.excess_weight * excess * excess,
               empty = c.gap_weight * over * over;
  return coverage == 255 ? full : coverage == 0 ? empty : 0.0;
}

SLICECORR_CLONES
std::int64_t count_wrong_alike(const std::uint8_t* coverage, const MiddleDoses& doses,
                               std::size_t count) {
  const double* __restrict const dark = doses.dark;
  const double* __restrict const added = doses.added;
  const double* __restrict const far = doses.far;
  const double a = doses.a;
  std::int64_t wrong = 0;
  for (std::size_t i = 0; i < count; ++i) {
    const double dose = dark[i] + added[i] + a * far[i];
    const std::int64_t full = coverage[i] == 255, empty = coverage[i] == 0, prints = dose >= 1.0;
    wrong += (full & (1 - prints)) | (empty & prints);
  }
  return wrong;
}

SLICECORR_CLONES
void cost_of_layers_alike(const std::uint8_t* coverage, const MiddleDoses& doses,
                          const LayerCosts& costs, std::span<double> cost) {
  const double* __restrict const dark = doses.dark;
  const double* __restrict const added = doses.added;
  const double* __restrict const far = doses.far;
  double* __restrict const out = cost.data();
  const double a = doses.a;
  const LayerCosts c = costs;
  for (std::size_t i = 0; i < cost.size(); ++i) {
    const double m = dark[i] + added[i] + a * far[i];
    out[i] = cost_of(coverage[i], m, c);
  }
}

}  // namespace

std::int64_t count_wrong(const std::uint8_t* coverage, const MiddleDoses& doses,
                         std::size_t count) {
  return doses.fades ? count_wrong_of_own(coverage, doses, count)
                     : count_wrong_alike(coverage, doses, count);
}

void cost_of_layers(const std::uint8_t* coverage, const MiddleDoses& doses, const LayerCosts& costs,
                    std::span<double> cost) {
  if (!doses.fades) {
    cost_of_layers_alike(coverage, doses, costs, cost);
    return;
  }
  for (std::size_t i = 0; i < cost.size(); ++i) {
    cost[i] = cost_of(coverage[i], dose_at(doses, i), costs);
  }
}

SLICECORR_CLONES
float least_sample(const float* dark, const float* added, const float* fade, float far) {
  constexpr std::size_t samples = 16;
  float dose[samples];
  for (std::size_t i = 0; i < samples; ++i) dose[i] = dark[i] + added[i] + far * fade[i];
  for (std::size_t n = samples / 2; n > 0; n /= 2) {
    for (std::size_t i = 0; i < n; ++i) dose[i] = dose[i + n] < dose[i] ? dose[i + n] : dose[i];
  }
  return dose[0];
}

}  // namespace slicecorr::detail
