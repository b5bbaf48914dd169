// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// From the names of a slicer's profiles to our definitions.
#pragma once

#include <string>

namespace slicecorr::post {

/// The definition whose name, or maker and product, is `profile`, or all of whose words are in it:
/// "Original Prusa SL1S SPEED" is prusa-sl1s. Of several the one with the most words counts; resins
/// for another wavelength than `wavelength_nm` (0: not known) do not, and printers where the profile
/// has a word more that makes it another model ("Pro", "2"). Of printers that fit alike one whose light
/// is measured counts. Empty when none or more than one fits. `kind`: "printer" or "resin".
std::string definition_of_profile(const std::string& profile, const std::string& kind,
                                  double wavelength_nm = 0);

}  // namespace slicecorr::post
