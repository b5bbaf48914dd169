/// Sentences that several programs and pages say alike.
#pragma once

#include <string>

#include "slicecorr/process.hpp"

namespace slicecorr::resins {

/// What correction aims at, beside the gel dose, in a sentence or two.
std::string aim_words(const Resin& resin);

}  // namespace slicecorr::resins
