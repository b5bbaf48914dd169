// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#pragma once

#include <memory>

#include "slicecorr/tomo/projector.hpp"

namespace slicecorr::tomo::detail {

/// The pair for light given at the plane of the axis: e^(-alpha u) alone, for alpha of either sign.
std::unique_ptr<Projector> make_axis_projector(const TomoGrid& grid, double alpha_per_mm);

}  // namespace slicecorr::tomo::detail
