// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file tomo/shown_light.hpp
/// What frames have to show so that light comes to where it is wanted, and what they do show, where
/// the axis leans or wobbles and the projector shines unevenly.
///
/// Light is moved sideways by parts of a column, by linear interpolation, before it is rounded to
/// levels. A whole column would do as well for one frame; but it leaves each frame up to half a
/// column beside its place, another one at each angle, which costs more contrast than what
/// interpolation blurs (docs/tomography-calibration.md). Rows go by whole rows, as slices consist of
/// whole rows. Pure functions, thread-safe.
#pragma once

#include <cstdint>
#include <vector>

#include "slicecorr/tomo/bench.hpp"

namespace slicecorr::tomo {

/// Light by column and slice, in units of the calibration, that shows `wanted`, light by the grid's
/// pixel: moved to where the axis is, and brighter where the projector is dim. The same light where
/// the axis is straight and steady and the projector shines evenly.
Light asked_light(const Bench& bench, Light wanted);

/// What levels by column and slice show there, mW/cm2.
Light shown_light(const Bench& bench, const std::vector<std::uint16_t>& levels);

}  // namespace slicecorr::tomo
