// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// A flat-field from plugs that were printed all over the plate.
#pragma once

#include <string>
#include <vector>

#include "slicecorr/stack.hpp"

namespace slicecorr::resins {

/// Relative intensity of the plate, white the brightest, a pixel for each plug of a filled in table
/// of `slicecorr testpart flat-field`: light goes with exp(height / hb). `height_e_um`: hb; 0: as
/// the table has it. `say` gets what was assumed. Throws `InputError` for another table, for other
/// units, and where fewer than half of the plugs were measured.
GreyImage light_of_plugs(const std::string& path, double height_e_um,
                         std::vector<std::string>& say);

}  // namespace slicecorr::resins
