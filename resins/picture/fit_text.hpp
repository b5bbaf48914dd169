// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// How parameters of fits are written for people.
#pragma once

#include <string>

#include "slicecorr/resins/fit.hpp"

namespace slicecorr::resins {

/// "NAME: title", or the title alone with a capital.
std::string titled(const std::string& name, std::string title);
/// The unit of D': (mW/cm²)^m·s, "mJ/cm²" for m = 1.
std::string prime_unit(double m);
/// Symbol of a parameter: Dc for dc_mj_cm2.
std::string symbol_of(const std::string& parameter);
/// "h = 527.4 um (95 %: 503 to 551)".
std::string parameter_words(const Parameter& parameter);

}  // namespace slicecorr::resins
