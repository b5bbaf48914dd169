// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What a recommendation says in words.
#pragma once

#include "slicecorr/resins/design.hpp"

namespace slicecorr::resins {

/// Adds reasons and warnings to a recommendation that meets the wish, from its figures.
void describe(const Resin& resin, const Printer& printer, const Wish& wish, Recommendation& r);

/// What the height to formulate for means where the display's light is not that of the calibration.
void describe_places(const Resin& resin, const Printer& printer, const Wish& wish,
                     Recommendation& r);

}  // namespace slicecorr::resins
