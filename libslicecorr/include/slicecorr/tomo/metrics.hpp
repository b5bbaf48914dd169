// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file tomo/metrics.hpp
/// How well a dose separates part from void, how long printing takes, and what a projector's grey
/// levels make of the light.
///
/// Voxels are those of `Target`: gel, void, others are not judged. Doses are in any unit, all of
/// one. Thread-safe; the same numbers for any number of threads.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "slicecorr/parallel.hpp"
#include "slicecorr/tomo/projector.hpp"
#include "slicecorr/tomo/volume.hpp"

namespace slicecorr::tomo {

struct Metrics {
  double min_gel = 0, max_gel = 0, max_void = 0;  ///< as given, not normalised
  std::size_t gel = 0, empty = 0;                 ///< numbers of voxels
  std::size_t void_gelled = 0;                    ///< void voxels with D >= min_gel
  /// void_gelled over gel + void: what gels wrongly when all of the part has gelled.
  double ver = 0;
  /// (min_gel - max_void) over the largest dose: process window, positive is good.
  double pw = 0;
  /// (max_gel - min_gel) over the largest dose: in-part dose range.
  double ipdr = 0;
  /// min_gel / max_void: void starts to gel at C times the time that prints the part. Infinite when
  /// no light falls into void.
  double contrast = 0;
  /// pw without the 0.05 % least of gel and the 0.05 % most of void.
  double trimmed_pw = 0;
  /// The best Jaccard index |P and T| / |P or T| of P = {D >= t}, searched exactly, and its t.
  double best_jaccard = 0, best_threshold = 0;
};

Metrics measure(const CellKinds& cells, const Array<float>& dose);
/// The same without what takes sorting all doses: no trimmed_pw, no Jaccard index.
Metrics measure_extremes(const CellKinds& cells, const Array<float>& dose);
/// Jaccard index of what is at or above `threshold`.
double jaccard(const CellKinds& cells, const Array<float>& dose, double threshold);
/// The part's voxel with the least dose, the first of several; where doses are wanted in bands, the one
/// with the least share of what it wants.
struct WeakVoxel {
  double dose = 0;
  std::string name;  ///< for people
};
WeakVoxel weakest_voxel(const Target& target, const Array<float>& dose);
/// Mean over maximum of the light, 0..1; 0 when all is dark. Lanes without a slice don't count.
double efficiency(const Light& light);

/// How long to turn. `alpha_a_per_mm` 1/mm of the active absorption.
struct PrintTime {
  int turns = 0;      ///< whole turns N
  double scale = 1;   ///< by which light is scaled down, so that the weakest gel voxel gets Dc
  double time_s = 0;  ///< N T_rot
  double floor_mj_cm3 = 0;  ///< most dose that black light leaves in void in that time
};

struct Exposure {
  double alpha_a_per_cm = 0;   ///< active absorption, > 0
  double turn_s = 0;           ///< T_rot, > 0
  double critical_mj_cm3 = 0;  ///< Dc, > 0
  double black_mw_cm2 = 0;     ///< that every pixel emits, >= 0
  double most_time_s = 0;      ///< 0: no limit
};

/// mJ/cm3 of one turn per unit of A^T light in mW/cm2.
double dose_of_turn(const TomoGrid& grid, const Exposure& exposure);

/// `dose` is A^T of the light in mW/cm2. Throws `InfeasibleError` when a gel voxel gets no light
/// (naming it), when the floor reaches Dc, or when it takes longer than allowed (giving N).
PrintTime plan_time(const ExecutionContext& context, const Projector& projector,
                    const Target& target, const Array<float>& dose, const Exposure& exposure);

/// Grey levels of a projector: `mw_cm2[level]`, which must not fall and must rise in all.
/// The level nearest to a light in mW/cm2, the lower of two.
std::uint16_t nearest_level(double wanted, const std::vector<double>& mw_cm2);
/// Levels nearest to light * mw_cm2_per_unit, in mW/cm2; laid out as the light.
std::vector<std::uint16_t> nearest_levels(const Light& light, double mw_cm2_per_unit,
                                          const std::vector<double>& mw_cm2);
/// The same, but what rounding adds or takes at an angle is made up for at the next one, by the same
/// pixel: better with few levels.
std::vector<std::uint16_t> carried_levels(const Light& light, double mw_cm2_per_unit,
                                          const std::vector<double>& mw_cm2);
/// What these levels show, mW/cm2. Lanes without a slice stay 0.
Light light_of_levels(const TomoGrid& grid, const std::vector<std::uint16_t>& levels,
                      const std::vector<double>& mw_cm2);

}  // namespace slicecorr::tomo
