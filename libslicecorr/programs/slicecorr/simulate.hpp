// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// The subcommand `simulate`.
#pragma once

#include <CLI/CLI.hpp>
#include <string>
#include <vector>

#include "options.hpp"
#include "programs/common/program.hpp"

namespace slicecorr::cli {

struct SimulateOptions {
  std::string stack, target, output, csv, dose_csv, lifts_csv;
  int x = -1, y = -1, row = -1, substeps = 0;
  std::vector<double> times_s;
  bool stationary = false;
  std::vector<double> blue_mw_cm2;
  double uv_ratio = 0, time_s = 0;
  void add_to(CLI::App& app);
};

int simulate(const SimulateOptions& options, const SetupOptions& setup,
             const ExecutionContext& context, Console& console);

}  // namespace slicecorr::cli
