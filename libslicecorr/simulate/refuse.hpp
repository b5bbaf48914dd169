// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What can't be followed in time.
#pragma once

#include <fmt/format.h>

#include "slicecorr/error.hpp"
#include "slicecorr/process.hpp"

namespace slicecorr {

/// Scattered light goes from column to column below the window, at every moment anew.
inline void refuse_scatter(const Resin& resin) {
  if (resin.scatter_um2_per_um == 0) return;
  throw InputError(fmt::format(
      "resin '{}' scatters light (scatter_um2_per_um), which is not followed in time; verify, probe "
      "and section tell what it does in the end",
      resin.name));
}

/// Layers of different heights.
inline void refuse_own_heights(const Process& process) {
  if (process.layer_heights_um.empty()) return;
  throw InputError(
      "layers of different heights are not followed in time; verify and probe tell what they print in "
      "the end");
}

}  // namespace slicecorr
