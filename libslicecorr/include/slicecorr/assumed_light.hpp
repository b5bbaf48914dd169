// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file assumed_light.hpp
/// Corrections for printers whose light nobody measured, from what is typical: never by default, and
/// told wherever figures are. Layer by layer alone, where the file's own exposure says how bright the
/// light is: people choose exposures that print, some two to five times what holds.
///
/// Light is counted in shares of the brightest level's, doses in seconds of it (light_unit.hpp).
/// Pure and thread-safe.
#pragma once

#include <string>
#include <string_view>

#include "slicecorr/process.hpp"

namespace slicecorr {

/// Exposures that people use are so many times the one that just holds, least and most. Layers are to
/// hold for the least; figures are told for the geometric mean of both.
inline constexpr double kLeastOfHolding = 2, kMostOfHolding = 5;
/// How sure that is, and typical curves and published heights, as `parse_uncertainty` takes it: 95 % of
/// doses lie between the two above; between powers of 2.2 and 3.5 of the level light of a third to a
/// half of the brightest differs by 12 %; heights that two labs find for one resin differ by some 10 %.
inline constexpr std::string_view kAssumedUncertainty = "ha=10%,dc=23%,light=12%";

/// "a typical monochrome LCD of 405 nm".
std::string_view words_of(AssumedLight light);

/// The word of the setting `assume`, "mono-lcd-405".
std::string_view name_of(AssumedLight light);

/// The kind that a word of the setting `assume` stands for; "typical": by the wavelength that the
/// printer file says, where it does.
AssumedLight assumed_light(std::string_view word, const Printer& printer);

/// `display`, whose light is to be measured, with that of a typical one:
/// - monochrome LCD: the level to the power of 3 (near 3.0 on 10-inch panels of 12k and 16k,
///   github.com/sn4k3/UVtools issue 1104); black is dark;
/// - DLP: in proportion to the level above 37 of 255 (three projectors: straight lines from levels of
///   25, 42 and 44 on, github.com/pcl-hub).
/// Throws `InputError` where the printer's light is measured, or has another wavelength.
Printer with_assumed_light(Printer display, AssumedLight light);

/// `resin` with the dose that makes the exposure of layers the mean multiple of what holds. `exposure_s`:
/// of full light; `holds`: gel doses that a layer needs at its far edge. Throws `InputError` where the
/// resin's dose is no sum of light, or its file tells it in seconds already.
Resin with_assumed_dose(Resin resin, double layer_um, double exposure_s, double holds);

/// The exposure for which `with_assumed_dose` gave `resin` its dose, s.
double exposure_of_assumed_dose(const Resin& resin, double layer_um, double holds);

/// Gel doses at a layer's far edge with which it holds for the least multiple; and what holds, of those.
double assumed_green_strength(double holds);
double holds_of_assumed(double green_strength);

/// What was assumed, in two sentences; empty where nothing was.
std::string assumption_in_words(const Printer& printer, const Resin& resin, const Process& process);

}  // namespace slicecorr
