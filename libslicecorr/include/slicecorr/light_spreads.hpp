// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file light_spreads.hpp
/// Whether light goes from column to column. Pure and thread-safe; throws nothing.
#pragma once

#include "slicecorr/process.hpp"

namespace slicecorr {

/// Curing light spreads at the window or in the resin, or the images of a patterned UV lamp spread.
inline bool light_spreads(const Printer& printer, const Resin& resin, const Process& process) {
  return !printer.spread.none() || resin.scatter_um2_per_um > 0 ||
         (process.uv.kind == UvKind::patterned && printer.uv && !printer.uv->spread.none());
}

}  // namespace slicecorr
