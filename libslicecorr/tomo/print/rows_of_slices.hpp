// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What light of frames falls on slices, of light that stays level.
#pragma once

#include <vector>

#include "tomo/print/direct_sum.hpp"

namespace slicecorr::tomo::detail {

/// A job's light, mW/cm² of the calibration: [angle][pixel][slice], z innermost, as light of one pixel goes
/// to all slices alike. Rows that show a slice's light meet other slices, too, where they are not as high
/// as slices, or lie between them. `uneven`: with what the projector's flat-field says.
std::vector<double> light_of_slices(const Judged& judged, bool uneven);

}  // namespace slicecorr::tomo::detail
