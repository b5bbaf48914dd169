// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What is left to wish for of a corrected stack.
#pragma once

#include "slicecorr/cure.hpp"
#include "slicecorr/parallel.hpp"
#include "slicecorr/predict.hpp"
#include "slicecorr/process.hpp"

namespace slicecorr::detail {

/// Tells what the user may want to change, by the figures of the corrected stack.
void tell_shortcomings(const Prediction& p, const CureModel& model, const Process& process,
                       int levels, const ExecutionContext& context);

}  // namespace slicecorr::detail
