// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Whether a target can be printed on a display: its size, what is left alone, and the light of all its places.
#pragma once

#include "slicecorr/parallel.hpp"
#include "slicecorr/place_models.hpp"
#include "slicecorr/process.hpp"
#include "slicecorr/setup.hpp"
#include "slicecorr/target.hpp"

namespace slicecorr::detail {

/// The printer, if the target's images are of its size, and what is left alone can be; else throws
/// `InputError`.
const Printer& fitting(const Setup& setup, const SliceSource& target);

/// Slices that will be shown so that all lit places cure to their end. Refuses with what would do for all
/// places: `InputError` for a speed beyond the stage's, `InfeasibleError` for light and travel. Reads the
/// target once when it is not clear without which of its places are lit.
int slices_to_show(const SliceSource& target, const PlaceModels& models, const Setup& setup,
                   const ExecutionContext& context);

}  // namespace slicecorr::detail
