// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file absorbance_in_layer.hpp
/// Absorbance heights that no resin has in layers of such a height: mostly mm where um are expected. Pure and
/// thread-safe.
#pragma once

#include "slicecorr/process.hpp"

namespace slicecorr {

/// Throws `InputError` where more than 20 absorbance heights (base 10) of the resin are in a layer: less than a part
/// in 1e20 of the light then passes, so that no grey reaches the next layer.
void check_absorbance_height(const Resin& resin, double layer_um);

}  // namespace slicecorr
