// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What black pixels add up to, layer by layer. Without UV light.
#pragma once

#include <vector>

#include "slicecorr/cure.hpp"

namespace slicecorr::detail {

/// The greatest dose that black light adds up to at a window, and the layer there; the layer after
/// all of `ratios` stands for normal ones.
struct BlackLight {
  double dose = 0;
  int layer = 0;
};
/// `ratios`: exposures over the normal one; the last holds for later layers, empty: 1.
BlackLight most_black(const CureModel& model, const std::vector<double>& ratios);

/// What black light adds up to where all exposures are normal, as a share of that with which it gels:
/// proportional to the exposure.
double alike_black(const CureModel& model);

}  // namespace slicecorr::detail
