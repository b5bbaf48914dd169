// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file chemistry_plots.hpp
/// A cell of resin under light, as a self-contained SVG. Thread-safe; throws nothing of its own.
#pragma once

#include <string>

#include "slicecorr/chemistry_cell.hpp"

namespace slicecorr::resins {

/// End groups used up and bonded over time, and below oxygen, chains and what else there is on a
/// logarithmic axis; light that is off is said. `name`: of the resin, first in the title.
std::string cell_svg(const Chemistry& c, const CellRun& run, const std::string& name = {});

}  // namespace slicecorr::resins
