// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What tuning writes into the files of resins.
#pragma once

#include <string>

#include "slicecorr/resins/tune.hpp"

namespace slicecorr::resins {

/// What stands before the covariance in `provenance.tuning`: the printer, and its light, since a
/// tuning holds for these, and what was told. `exchange`: the share of resin that lifts exchange, too.
std::string tuned_with(const Printer& printer, bool exchange);

}  // namespace slicecorr::resins
