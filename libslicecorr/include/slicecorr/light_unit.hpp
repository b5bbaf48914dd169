// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file light_unit.hpp
/// In what light and doses are told. A correction needs ratios of light alone, so who has no power
/// meter measures in units of the brightest grey level: intensities are shares of its light, doses
/// seconds of it (docs/calipers.md). Printer and resin must have the same unit; what counts light
/// absolutely, UV light that inhibits above all, needs mW/cm².
///
/// Pure and thread-safe.
#pragma once

#include <string>
#include <string_view>

#include "slicecorr/process.hpp"

namespace slicecorr {

/// As files say it (`[blue] unit`, `[cure] unit`): "mW/cm2", "of the brightest level".
std::string_view unit_in_files(LightUnit unit);
/// What follows an intensity in a text: "mW/cm²", "of the brightest level".
std::string_view unit_of_light(LightUnit unit);
/// What follows an areal dose: "mJ/cm²", "s of full light".
std::string_view unit_of_dose(LightUnit unit);

/// Whether the resin's doses are seconds of full light. (Its `critical_dose_mj_cm3` is then their
/// volumetric counterpart, s/cm, and all fields that are named for mW count light of the brightest
/// level.)
bool is_relative(const Resin& resin);
bool is_relative(const Printer& printer);

/// The areal dose that a resin of such a unit is aimed at: seconds of the brightest level's light that
/// gel a surface, times what a dose factor makes of them.
double critical_dose_s(const Resin& resin);

/// Throws `InputError`, naming both, where printer and resin have different units.
void check_same_unit(const Printer& printer, const Resin& resin);
/// Throw `InputError` where the unit is not mW/cm², which `what` needs, some words: "resin flow".
void refuse_relative(const Printer& printer, const char* what);
void refuse_relative(const Resin& resin, const char* what);

}  // namespace slicecorr
