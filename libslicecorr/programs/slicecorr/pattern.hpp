// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// The subcommand `pattern`: what an image of light makes of a film of resin, by its chemistry.
#pragma once

#include <string>

#include "programs/common/program.hpp"

namespace slicecorr::cli {

struct PatternOptions {
  std::string image, resin, correct, json, csv, output, curve, sides = "periodic";
  double pixel_um = 0, intensity_mw_cm2 = 0, time_s = 0, dark_s = 0;
  double spread_um = 0, film_um = 0, supply_per_s = 0, step_ms = 0;
  double used_up_by_s = 0, margin = 0.15;
  int refine = 1, slice = -1, steps = 500;
  bool bleaching = false;
};

/// Adds `pattern`, which keeps what it is told in `options`.
void add_pattern(Program& program, PatternOptions& options);

}  // namespace slicecorr::cli
