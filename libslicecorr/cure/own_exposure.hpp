// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Layer by layer without UV light: what a slice's exposure by itself leaves in its layer of fresh resin,
/// which is what holds when the platform lifts (docs/lifts.md). Under UV light own_doses.hpp says it.
#pragma once

#include "slicecorr/cure.hpp"

namespace slicecorr::detail {

/// Relative doses of one exposure.
struct OwnExposure {
  double window = 0;  ///< beside the window
  double skin = 0;    ///< where a film's skin ends, `LiftModel::skin` of the layer from the window
  double far = 0;     ///< at the layer's far edge
};

/// `phi`: of the light that reaches the place, for a normal exposure (`CureModel::level_phi`), >= 0.
/// `model`: layer by layer, with lifts, without UV light.
OwnExposure own_exposure(const CureModel& model, int slice, double phi);

}  // namespace slicecorr::detail
