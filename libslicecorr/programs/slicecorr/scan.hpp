// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// The subcommand `scan`: printed parts that were scanned.
#pragma once

#include <string>
#include <vector>

#include "programs/common/mesh_options.hpp"
#include "programs/common/program.hpp"
#include "programs/common/setup_options.hpp"

namespace slicecorr::cli {

struct ScanOptions {
  MeshOptions mesh;  ///< its parts are the design
  SetupOptions setup;
  std::string scan, stack, unit = "auto", json, page;
  double voxel_um = 0;                   ///< of volumes
  double reach_um = 0;                   ///< 0: a twentieth of the surface's diagonal
  std::vector<std::string> comparisons;  ///< of drift
  int settled = 0;                       ///< 0: all
};

/// Adds `scan`, which keeps what it is told in `options`.
void add_scan(Program& program, ScanOptions& options);

}  // namespace slicecorr::cli
