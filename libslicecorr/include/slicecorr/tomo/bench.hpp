/// @file tomo/bench.hpp
/// A tomographic printer and its resin as the operators see them: which voxels, angles and pixels
/// there are, what the vial does to each pixel's light, and where pixels and slices lie in frames.
///
/// Frames are the projector's images as seen from it, before any mirror of the printer. Plain
/// values; functions are thread-safe.
#pragma once

#include <vector>

#include "slicecorr/process.hpp"
#include "slicecorr/tomo/metrics.hpp"
#include "slicecorr/tomo/projector.hpp"

namespace slicecorr::tomo {

/// What is to be computed on.
struct Sampling {
  double voxel_mm = 0;  ///< side of a voxel, at least the pixel's pitch
  int slices = 0;       ///< along z, middled on the optical axis
  int angles = 0;       ///< frames of a turn
};

struct Bench {
  TomoGrid grid;                 ///< all of the resin: voxels from axis to wall
  RayTables rays;                ///< of the grid's pixels
  Exposure exposure;             ///< of one turn
  double resupply_mj_cm3_s = 0;  ///< of inhibitor
  std::vector<double> mw_cm2;    ///< of each grey level
  double radius_mm = 0;          ///< of the resin
  double reach_mm = 0;           ///< up to which light comes from all directions
  double alpha_r = 0;            ///< absorption times the resin's radius
  int frame_width = 0, frame_height = 0;
  int first_column = 0;        ///< of frames, that shows the grid's pixel 0
  std::vector<int> row_slice;  ///< per row of frames the slice that it lights; -1: none
  bool clockwise = true;
  /// Frames are shown in order while the vial turns; this one is shown at angle m.
  int frame_of_angle(int m) const { return clockwise || m == 0 ? m : grid.angles - m; }
};

/// Voxels along x and along y of the grid that the resin holds: an odd number, so that one is on the
/// axis. Throws `InputError` when the printer has no vial, and for voxels too large or too small.
int voxels_across(const Printer& printer, double voxel_mm);

/// Throws `InputError` naming what is missing or does not fit: light that is not telecentric, a
/// printer whose rows are higher than a voxel, slices above or below the image, fewer than 3 angles,
/// more frames than the projector shows in a turn.
Bench make_bench(const Printer& printer, const Resin& resin, const Sampling& sampling);

/// Angles of a turn at which voxels at this distance from the axis are resolved: pi r / p for half a
/// turn (Kelly's thesis, 5.5.2).
int resolving_angles(double radius_mm, double voxel_mm);

/// As many angles as resolve the voxels at `part_radius_mm`, as far as the projector can show them.
int usual_angles(const Printer& printer, double part_radius_mm, double voxel_mm);

}  // namespace slicecorr::tomo
