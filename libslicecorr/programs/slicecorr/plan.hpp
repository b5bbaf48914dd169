// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// The subcommand `plan`: how fast a part can be printed, and what limits it.
#pragma once

#include <string>
#include <vector>

#include "options.hpp"
#include "programs/common/program.hpp"
#include "slicecorr/plan.hpp"

namespace slicecorr::cli {

struct PlanOptions {
  MeshOptions mesh;  ///< meshes, or one stack
  SetupOptions setup;
  PlanAsk ask;
  double light_error_percent = 1;
  std::vector<std::string> free, orientations;
  std::string json, output, slice_speeds;
};

/// Adds `plan`, which keeps what it is told in `options`.
void add_plan(Program& program, PlanOptions& options);

/// The answer for people.
std::string plan_text(const PrintPlan& plan);

}  // namespace slicecorr::cli
