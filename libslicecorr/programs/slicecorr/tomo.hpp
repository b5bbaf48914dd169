/// The subcommands of `tomo`: printing the whole part at once.
#pragma once

#include <string>
#include <vector>

#include "programs/common/mesh_options.hpp"
#include "programs/common/program.hpp"
#include "programs/common/setup_options.hpp"
#include "tomo_views.hpp"

namespace slicecorr::cli {

struct TomoOptions {
  MeshOptions mesh;
  std::string printer, resin, volume, output, job, shown, dose, json;
  std::vector<std::string> inserts;
  std::string method = "ladder", window = "hamming";
  double voxel_mm = 0, most_time_s = 0, clip_sigma = 0, stop_error = 0;
  int angles = 0, iterations = 0;
  double checkpoint_s = 5;
  bool beyond_reach = false, resume = false;
  TomoViewOptions views;
};

/// Adds `tomo` with its subcommands, which keep what they are told in `options`.
void add_tomo(Program& program, TomoOptions& options);

}  // namespace slicecorr::cli
