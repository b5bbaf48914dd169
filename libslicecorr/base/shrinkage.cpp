// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/shrinkage.hpp"

#include <fmt/format.h>

namespace slicecorr {

std::string Shrinkage::to_json() const {
  return fmt::format(
      R"({{"plane_per_cent":{},"z_per_cent":{},"first_layers_growth_um":{},"first_layers_height_um":{}}})",
      plane_per_cent, z_per_cent, growth_um, height_um);
}

std::string shrinkage_in_words(const Shrinkage& shrinkage) {
  std::string words;
  if (shrinkage.shrinks()) {
    words = fmt::format("shrinks by {:.4g} % in the plane and {:.4g} % along z",
                        shrinkage.plane_per_cent, shrinkage.z_per_cent);
  }
  if (shrinkage.grows()) {
    words += fmt::format("{}first layers stand out by {:.4g} um at the platform, none at {:.4g} um",
                         words.empty() ? "" : "; ", shrinkage.growth_um, shrinkage.height_um);
  }
  return words;
}

}  // namespace slicecorr
