// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What figures of a resin are worth that nobody measured on the printer at hand.
#pragma once

#include <string>
#include <vector>

#include "slicecorr/parallel.hpp"
#include "slicecorr/process.hpp"
#include "slicecorr/setup.hpp"

namespace slicecorr::cli {

/// Of a resin that nobody measured on the printer at hand: standard deviations of the logarithms of absorbance
/// height and dose. The ranges of 24 laboratories are a factor of 7 and of 70; of so many normal values
/// the greatest is 3.9 standard deviations above the least, in the mean (docs/measured.md).
inline constexpr double kDatabaseHeightSd = 0.5, kDatabaseDoseSd = 1.1;

/// A sentence where a name leads to a resin of the installed database; empty where it leads to a file of the
/// user's own, or is a path. Where light is `assumed` the dose is the exposure's, and no matter of the database.
std::string database_band(const std::string& resin, AssumedLight assumed = AssumedLight::none);
/// The same of what a stack was made with: where its resin has name and numbers of one of the installed
/// database.
std::string database_band(const Resin& resin, AssumedLight assumed = AssumedLight::none);
/// Tells it, where there is something to tell.
void tell_database_band(const std::string& resin, const ExecutionContext& context,
                        AssumedLight assumed = AssumedLight::none);
void tell_database_band(const Resin& resin, const ExecutionContext& context,
                        AssumedLight assumed = AssumedLight::none);

/// What a print is worth, for who looks at nothing but its files: that the printer is said to show no grey where
/// light is assumed, and the resin of the database. `chosen`: names, or nothing where a stack says them.
std::vector<std::string> unmeasured_in_words(const SetupChoices& chosen, const Setup& setup);

}  // namespace slicecorr::cli
