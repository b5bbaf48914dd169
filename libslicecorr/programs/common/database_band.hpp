// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What figures of a resin are worth that nobody measured on the printer at hand.
#pragma once

#include <string>

#include "slicecorr/parallel.hpp"

namespace slicecorr::cli {

/// A sentence where a name leads to a resin of the installed database; empty where it leads to a file of the
/// user's own, or is a path.
std::string database_band(const std::string& resin);
/// Tells it, where there is something to tell.
void tell_database_band(const std::string& resin, const ExecutionContext& context);

}  // namespace slicecorr::cli
