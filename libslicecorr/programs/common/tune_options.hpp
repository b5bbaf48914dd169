// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What `tune` can be told: `resinctl` reads it, `slicecorr`, which hands its `tune` over, offers it
/// where commands are completed.
#pragma once

#include <CLI/CLI.hpp>
#include <string>
#include <vector>

#include "programs/common/setup_options.hpp"

namespace slicecorr::cli {

struct TuneOptions {
  LightOptions light;
  std::vector<std::string> tables;
  std::string printer, resin, printed, output, printer_output;
  double sigma_um = 10;
  std::vector<std::string> scans;
  std::vector<std::string>
      stacks;  ///< of the scans: what was printed; one for all, or one for each
  std::string scan_unit = "auto";
  double voxel_um = 0;  ///< of volumes
  std::vector<std::string> seek;
  std::string next, target;  ///< a stack to correct anew, of this design
  CLI::Option* other_wavelength = nullptr;
  /// `required`: printer and resin must be given.
  void add_to(CLI::App& app, bool required);
};

}  // namespace slicecorr::cli
