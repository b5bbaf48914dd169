// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What full light and black come to in the slices that fail first: what verdicts and ways out of refusals
/// go by.
#pragma once

#include "slicecorr/cure.hpp"
#include "slicecorr/process.hpp"

namespace slicecorr::detail {

inline bool is_continuous(const Process& process) {
  return process.mode == ExposureMode::continuous;
}

/// Whether slices go at speeds of their own and lamps stay as they are: the one speed of the process is
/// then none of any slice.
bool has_own_speeds(const Process& process);

/// Which slices fail first: those that count for most where black gels, those that count for least where
/// full light does not.
enum class Counts { most, least };

/// The speed, mm/h, that times a dose of `limit_doses` is the speed at which that dose is 1: the process's,
/// or that of all slices where they have their own.
double pace_mm_h(const CureModel& model, const Process& process, Counts counts);

/// The layer with the shortest exposure, or the highest for it: if it gels, all do.
int weakest_layer(const CureModel& model);

/// The relative dose of lit pixels, which must be above 1 (layer by layer without UV: at least 1),
/// and that of black, which must be below.
struct LimitDoses {
  double lit = 0, black = 0;
};
LimitDoses limit_doses(const CureModel& model);

bool is_plain_layerwise(const CureModel& model);

/// Whether the dose of lit pixels is enough. Layer by layer an exposure of just the least time is
/// feasible, so rounding is allowed for.
bool gels(const CureModel& model, double lit_dose);

/// Whether black gels by the normal exposure already, not only by the longer ones of some layers.
bool black_as_a_rule(const CureModel& model);

}  // namespace slicecorr::detail
