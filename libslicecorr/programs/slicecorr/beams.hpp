// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// `slicecorr beams`: printing whole parts with a few still images at once.
#pragma once

#include <string>
#include <vector>

#include "programs/common/mesh_options.hpp"
#include "programs/common/program.hpp"
#include "programs/common/setup_options.hpp"

namespace slicecorr::cli {

struct BeamsArguments {
  MeshOptions mesh;  ///< parts, or none with a volume
  LightOptions light;
  std::string volume;  ///< .npy in place of meshes
  double voxel_mm = 0;
  std::string printer, resin, output, json, report, dose, cells;
  int beams = 0;  ///< 0: those of the printer, else 3
  std::string images = "silhouette";
  std::vector<double> vat_mm;   ///< empty: the printer's, else up to the part
  double intensity_mw_cm2 = 0;  ///< 0: the brightest of the printer
  double exposure_s = 0;        ///< 0: the middle of the window
  int steps = 0;
};

/// Adds `beams`, which keeps what it is told in `options`.
void add_beams(Program& program, BeamsArguments& options);

}  // namespace slicecorr::cli
