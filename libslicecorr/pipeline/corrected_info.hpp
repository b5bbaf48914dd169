// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What a corrected stack says of itself, besides what a scan of its target fills in.
#pragma once

#include "bands/bands.hpp"
#include "slicecorr/setup.hpp"
#include "slicecorr/stack.hpp"

namespace slicecorr::detail {

/// `grid`: of the slices that are written to `file`.
inline void fill_corrected(StackInfo& info, const Grid& grid, const SliceSource& target,
                           const Setup& setup, const StackFile& file) {
  info.grid = grid;
  set_frame(info, target);
  info.kind = StackKind::corrected;
  info.printer = setup.printer;
  info.resin = setup.resin;
  info.process = setup.process;
  if (!target.edge_heights()) info.process->surface = Surface::slices;
  info.lift_times = setup.lift_times;
  info.original_sha256 = file.original_sha256;
}

}  // namespace slicecorr::detail
