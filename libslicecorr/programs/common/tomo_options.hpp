// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What every program that prints tomographically can be told of the part and of how light is found.
#pragma once

#include <CLI/CLI.hpp>
#include <cstdint>
#include <string>
#include <vector>

#include "programs/common/mesh_options.hpp"
#include "slicecorr/parallel.hpp"
#include "slicecorr/process.hpp"
#include "slicecorr/tomo/print.hpp"

namespace slicecorr::cli {

struct TomoPrintOptions {
  MeshOptions mesh;                  ///< parts, or none with a volume
  std::string volume;                ///< .npy in place of meshes
  std::vector<std::string> inserts;  ///< meshes, with a volume volumes of its size
  double voxel_mm = 0;               ///< 0: the layer height, else the pixel's pitch
  std::string method = "ladder", window = "hamming";
  int angles = 0, iterations = 0;         ///< 0: the usual ones
  double most_time_s = 0;                 ///< 0: no limit
  double clip_sigma = 0, stop_error = 0;  ///< OSMO's; 0: neither
  bool beyond_reach = false;
  double k0 = 0, osmo_low = 0, osmo_high = 0;  ///< 0: the usual ones
  std::vector<double> at_mm;                   ///< x, y, z of each part, or none
  bool base_on_axis = false;
  int hold = 0;  ///< frames of each angle; 0: the usual ones
  /// Doses that are wanted: of each voxel, off by how much, with which weight.
  std::string wanted, weights, conversion_curve;
  std::string tolerance;  ///< a number, or numbers
  double white = 0;       ///< what white in images stands for; 0: none

  /// All but parts, volume, placement, and what follows.
  void add_to(CLI::App& app);
  /// Where parts lie in the vial.
  void add_places_to(CLI::App& app);
  /// Numbers of OSMO and of filters.
  void add_numbers_to(CLI::App& app);
  /// Doses that are wanted in place of a part.
  void add_wanted_to(CLI::App& app);
  /// Throws `InputError` for a volume whose voxels have no size.
  double side_of_voxel_mm(const Printer& printer) const;
};

/// All that `tomo::solve_print` is to be told of printing with this printer.
struct TomoPrint {
  tomo::Box<std::uint8_t> part;
  double voxel_mm = 0;
  tomo::PrintOptions options;  ///< with the inserts
};
/// Reads meshes or volumes, as voxels on the grid of the vial. Throws `InputError` for inserts that
/// do not fit the part, places that are not one for each part, parts that overlap, and for options of
/// another method.
TomoPrint read_tomo_print(const TomoPrintOptions& options, const Printer& printer,
                          const ExecutionContext& context);
/// The same of doses that are wanted (`TomoPrintOptions::wanted`) in this resin.
TomoPrint read_wanted_print(const TomoPrintOptions& options, const Printer& printer,
                            const Resin& resin, const ExecutionContext& context);

}  // namespace slicecorr::cli
