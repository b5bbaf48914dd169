/// What every program that prints tomographically can be told of the part and of how light is found.
#pragma once

#include <CLI/CLI.hpp>
#include <cstdint>
#include <string>

#include "programs/common/mesh_options.hpp"
#include "slicecorr/parallel.hpp"
#include "slicecorr/process.hpp"
#include "slicecorr/tomo/print.hpp"

namespace slicecorr::cli {

struct TomoPrintOptions {
  MeshOptions mesh;     ///< parts, or none with a volume
  std::string volume;   ///< .npy in place of meshes
  double voxel_mm = 0;  ///< 0: the layer height, else the pixel's pitch
  std::string method = "ladder", window = "hamming";
  int angles = 0, iterations = 0;  ///< 0: the usual ones
  double most_time_s = 0;          ///< 0: no limit
  bool beyond_reach = false;

  /// All but parts, volume and placement.
  void add_to(CLI::App& app);
  /// Throws `InputError` for a volume whose voxels have no size.
  double side_of_voxel_mm(const Printer& printer) const;
  tomo::PrintOptions print_options() const;
};

/// Reads the meshes or the volume, as voxels on the grid of the vial.
tomo::Box<std::uint8_t> tomo_part(const TomoPrintOptions& options, const Printer& printer,
                                  const ExecutionContext& context);

}  // namespace slicecorr::cli
