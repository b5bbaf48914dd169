// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <fmt/format.h>

#include "slicecorr/error.hpp"
#include "slicecorr/tomo/bench.hpp"

namespace slicecorr::tomo {

void refuse_uncounted_spread(const Printer& printer, const Resin& resin) {
  if (!printer.spread.none()) {
    throw InputError(fmt::format(
        "printer '{}': spread in [blue] is not counted where light comes from the sides; expected "
        "none, as its doses would be those of sharper light",
        printer.name));
  }
  if (resin.scatter_um2_per_um > 0) {
    throw InputError(fmt::format(
        "resin '{}': scatter_um2_per_um is not counted where light comes from the sides; expected "
        "0, as its doses would be those of a clear resin",
        resin.name));
  }
}

}  // namespace slicecorr::tomo
