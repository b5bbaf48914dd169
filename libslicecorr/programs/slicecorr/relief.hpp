// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// The subcommand `relief`: one exposure for wanted fronts and backs.
#pragma once

#include <string>

#include "programs/common/program.hpp"
#include "programs/common/setup_options.hpp"

namespace slicecorr::cli {

struct ReliefOptions {
  LightOptions light;
  std::string back, front, printer, resin, output, uv_output, json;
  double back_most_um = 0, front_most_um = 0, time_s = 0;
};

/// Adds `relief`, which keeps what it is told in `options`.
void add_relief(Program& program, ReliefOptions& options);

}  // namespace slicecorr::cli
