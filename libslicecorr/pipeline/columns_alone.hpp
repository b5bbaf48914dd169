// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// The levels of columns that are corrected each as if it stood alone.
#pragma once

#include <cstdint>
#include <vector>

#include "base/coded_band.hpp"
#include "pipeline/place_plans.hpp"
#include "slicecorr/target.hpp"

namespace slicecorr::detail {

/// Levels of a band, `PlacePlans::all_layers` slices, the last one first. Throws as
/// `BandCorrector`.
CodedBand levels_alone(const SliceSource& target, const PlacePlans& plans, const PixelBox& band);

/// Makes levels the pixels that show them.
void to_pixels(std::vector<std::uint8_t>& levels, int count);

}  // namespace slicecorr::detail
