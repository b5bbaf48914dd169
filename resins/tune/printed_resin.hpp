// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// The resin as a print counts it.
#pragma once

#include "slicecorr/process.hpp"

namespace slicecorr::resins {

/// With lifts the dose that gels counts, without a factor on it; else the dose that is aimed at.
Resin printed_resin(const Resin& resin, const Process& process);

}  // namespace slicecorr::resins
