// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Light that the platform sends back, inside a layer (cure.hpp).
#pragma once

#include <vector>

#include "cure/walkers.hpp"
#include "slicecorr/cure.hpp"

namespace slicecorr::detail {

/// What the dose of layer `slice` does between `begin` and `end`, the doses at the ends of its pieces
/// with the light from the platform. Adds to `out` where it passes 1, and lowers `out.least`.
void look_along(const CureModel& model, int slice, const std::vector<Stretch>& pieces, double begin,
                double end, InsideLayer& out);

}  // namespace slicecorr::detail
