// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// The loops of the correction under UV light that take most of its time, compiled for each
/// instruction set with the same bits. Pure functions of what they are given.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

namespace slicecorr::detail {

/// The light that a slice gives the layers within reach of the tables, and another that takes its
/// place.
struct ChangedLight {
  /// `ExtraLight::upwards` of the old level; null: it was black, which gives nothing.
  const double *from_node, *from_middle;
  const double *to_node, *to_middle;  ///< of the new one
  double times;                       ///< how often the slice counts
  std::size_t reach;                  ///< `ExtraLight::reach`: a multiple of 8
};
/// Adds what changes to the doses of `reach` layers from `node` and `middle` on.
void change_light(const ChangedLight& light, double* node, double* middle);

/// The same inside layers: rows of 16 samples, of which the first belongs to the slice's own layer.
struct ChangedSamples {
  const float *from, *to;
  float times;
  std::size_t rows;
};
/// `last`: samples of the slice's own layer; those of the layers above lie before it.
void change_samples(const ChangedSamples& light, float* last);

/// What nodes that follow each other have and may still get.
struct NodesAsking {
  const double* demand;  ///< 0 and less: none
  const double* dark;    ///< dose of black slices
  const double* added;   ///< by slices within reach of the tables; null: none
  const double* far;     ///< by those beyond, times
  double far_times;
  const double* powers;  ///< `far_times` falls with the distance by these; null: `far` is by node
  const double* rest;    ///< what can still come
  double margin;
};
/// The dose that a node needs beyond what it has.
inline double asked_by(const NodesAsking& nodes, std::size_t i) {
  const double has = nodes.powers ? nodes.dark[i] + nodes.far_times * nodes.powers[i]
                                  : nodes.dark[i] + nodes.added[i] + nodes.far_times * nodes.far[i];
  return nodes.demand[i] + nodes.margin - has;
}
/// One past the last of the first `count` nodes that needs more than can still come; 0: none does.
std::size_t last_asking(const NodesAsking& nodes, std::size_t count);

/// Doses in the middles of layers, as ColumnDoses keeps them.
struct MiddleDoses {
  const double *dark, *added, *far;
  double a;
  /// Where layers are not alike, in place of `a`: of each layer; null: `a`.
  const double* fades = nullptr;
  double times(std::size_t i) const { return fades ? fades[i] : a; }
};
/// How many of `count` layers are full and don't print, or empty and do.
std::int64_t count_wrong(const std::uint8_t* coverage, const MiddleDoses& doses, std::size_t count);

/// What doses in the middles of layers cost (InhibitedTuning).
struct LayerCosts {
  double core_dose, core_weight, excess_dose, excess_weight, gap_dose, gap_weight;
};
/// What each of `count` layers costs, to `cost`.
void cost_of_layers(const std::uint8_t* coverage, const MiddleDoses& doses, const LayerCosts& costs,
                    std::span<double> cost);

/// The least of 16 sums dark + added + far * fade.
float least_sample(const float* dark, const float* added, const float* fade, float far);

}  // namespace slicecorr::detail
