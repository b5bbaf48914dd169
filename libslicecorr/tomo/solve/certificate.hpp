// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Bounds of contrast, slice by slice; see `contrast_bound`.
#pragma once

#include <vector>

#include "slicecorr/tomo/projector.hpp"
#include "slicecorr/tomo/volume.hpp"

namespace slicecorr::tomo::detail {

/// Of each slice of a block; infinite where its dose proves nothing.
std::vector<double> bounds_of_block(const Projector& projector, std::size_t block,
                                    const Kind* kinds, const float* dose, double rung,
                                    const ExecutionContext& context);

}  // namespace slicecorr::tomo::detail
