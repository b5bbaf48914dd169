// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Where the fit of a model begins.
#pragma once

#include <string>

#include "fit/prepare.hpp"

namespace slicecorr::resins {

/// Throws `InputError`: why the model can't be fitted.
[[noreturn]] void refuse_fit(const PreparedFit& prepared, const std::string& why);

/// First values of all parameters, from the observations and from what is fixed.
void choose_starts(PreparedFit& s, const FitOptions& options);

}  // namespace slicecorr::resins
