// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// The subcommand `flow`: what a part does to the resin under it.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "programs/common/mesh_options.hpp"
#include "programs/common/program.hpp"
#include "programs/common/setup_options.hpp"
#include "slicecorr/flow_window.hpp"

namespace slicecorr::cli {

struct FlowOptions {
  MeshOptions mesh;  ///< meshes, or one stack
  LightOptions light;
  std::string printer, resin, json, output, profile;
  double speed_mm_h = 0, gap_um = 0, pitch_um = 0;
  std::optional<double> uv_mw_cm2, blue_mw_cm2;
  std::vector<double> platform_mm;
  int every = 1;
  bool in_time = false;
  double disc_radius_mm = 0, strip_half_width_mm = 0;  ///< in place of a part, in time
  double first_gap_um = 0;
  int slices = 0;  ///< followed in time; 0: not said
  FlowWindow window;
};

/// Adds `flow`, which keeps what it is told in `options`.
void add_flow(Program& program, FlowOptions& options);

}  // namespace slicecorr::cli
