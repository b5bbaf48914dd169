// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/absorbance_in_layer.hpp"

#include <fmt/format.h>

#include "slicecorr/error.hpp"

namespace slicecorr {

namespace {

/// Slices of more absorbance heights than this let less than a part in 1e20 of the light pass: no grey
/// reaches the next one, and no lamp makes up for it.
constexpr double kMostHeightsInSlice = 20;

}  // namespace

void check_absorbance_height(const Resin& resin, double layer_um) {
  const double um = resin.absorbance_height10_um;
  if (!(layer_um > kMostHeightsInSlice * um)) return;
  throw InputError(fmt::format(
      "resin '{}' has an absorbance height of {:g} um: {:.0f} of them are in a layer of {:g} um, which then "
      "lets no light pass; expected at least {:g} um: is it {:g} mm, which are {:g} um?",
      resin.name, um, layer_um / um, layer_um, layer_um / kMostHeightsInSlice, um, um * 1000));
}

}  // namespace slicecorr
