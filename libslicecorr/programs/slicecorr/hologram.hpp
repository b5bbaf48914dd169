// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// `slicecorr hologram`: phase images for a phase-only display.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "programs/common/program.hpp"

namespace slicecorr::cli {

struct HologramArguments {
  std::vector<std::string> targets;
  std::string output, json, picture, stack;
  double pitch_um = 0, wavelength_nm = 0, focal_mm = 0;
  std::vector<double> relay_mm;                       ///< f1, f2
  std::vector<int> display_px;                        ///< width, height
  std::vector<double> dx_mm, dy_mm, dz_mm, stack_mm;  ///< per target; first, last, step
  double target_pixel_um = 0, stroke_turns = 0, fill = 0, reflection = 0.005;
  double inhibition_s = 0, frame_hz = 60;
  int levels = 256, steps = 50, holograms = 1;
  std::uint32_t seed = 1;
  bool free_outside = false;
};

void add_hologram(Program& program, HologramArguments& o);

}  // namespace slicecorr::cli
