// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file tomo/rays.hpp
/// Light whose slices are not independent: rays that spread from a pinhole or fill an aperture, bent
/// by a dry vial, rising or falling on their way through the resin.
///
/// The vial turns and the light does not, so the rays of one frame are kept and all angles use them.
/// A ray is taken where it crosses the rows of voxels, or their columns if it runs more along x than
/// along y; there it lies between two voxels and two slices:
///   D1[v] = alpha_a dt (p^2 / V) sum_m sum_pixels sum_rays I power sum_crossings dl e^(-alpha l) tau(v),
/// p^2 the pixel's area on the plane of the axis, V a voxel's volume, dl the way from one crossing to
/// the next, l the way in resin up to it, tau the voxel's linear weight there. A takes the same
/// weights the other way, so that A and A^T are transposes of each other. Fields are in units of light
/// times angles, as of `Projector`.
///
/// Plain values; functions are thread-safe.
#pragma once

#include <memory>
#include <vector>

#include "slicecorr/parallel.hpp"
#include "slicecorr/process.hpp"
#include "slicecorr/tomo/projector.hpp"
#include "slicecorr/tomo/volume.hpp"

namespace slicecorr::tomo {

/// A part of the projector's image, of whose pixels one in `wide` x `high` has a value of its own; light
/// is linear between them. It is that in the middle of its group of pixels, or left of and above it.
struct PixelWindow {
  int first_column = 0, first_row = 0;  ///< of the projector, rows downwards from 0
  int columns = 0, rows = 0;            ///< of groups
  int wide = 1, high = 1;
  /// The pixel with the value of this group, of the projector.
  int column_of(int group) const { return first_column + group * wide + (wide - 1) / 2; }
  int row_of(int group) const { return first_row + group * high + (high - 1) / 2; }
};

/// One ray in the resin, as seen where it is parallel to u: through t_mm from u = -half_mm to
/// half_mm.
struct LabRay {
  double turn_rad = 0;    ///< th' - th
  double t_mm = 0;        ///< line in the plane
  double half_mm = 0;     ///< half of its way in the plane; 0: it misses the resin
  double entry_z_mm = 0;  ///< z at u = -half_mm
  double slope = 0;       ///< dz/du
  double power = 0;       ///< share of the pixel's power that comes into the resin along this ray
};

/// All rays of one frame.
struct LabRays {
  int columns = 0, rows = 0;  ///< rows upwards, the lowest first
  int per_pixel = 1;
  double pixel_area_mm2 = 0;  ///< of a group of pixels, on the plane of the axis without the vial
  double alpha_per_mm = 0;    ///< along the way
  double vial_mm = 0;         ///< inner radius
  std::vector<LabRay> rays;   ///< [column][row][ray of the pixel]
};

/// Where the rays of a pixel cross its aperture, of unit radius: one in the middle; 13 in a hexagon
/// of cells of the same area, 1 + 6 + 6 as Webber et al. have them; any other number in a spiral of
/// equal areas.
struct AperturePoint {
  double x = 0, z = 0;
};
std::vector<AperturePoint> aperture_points(int rays);

/// Throws `InputError` when the printer has no vial or optics, for windows that reach over the
/// image, and for a pinhole inside of the vial.
LabRays lab_rays(const Printer& printer, double n_resin, double alpha_per_mm,
                 const PixelWindow& window);

/// The pair of operators of these rays on `grid`, whose `rows` and `pixels` are the window's rows
/// and columns; the same bytes for any number of threads. A ray ends before the first crossing that
/// is nearest to an opaque voxel (coverage > 0) of `insert`, which has this grid. Throws `InputError`
/// for a grid that does not fit.
std::unique_ptr<Projector> make_ray_projector(const TomoGrid& grid, const LabRays& rays,
                                              const Volume* insert = nullptr);

}  // namespace slicecorr::tomo
