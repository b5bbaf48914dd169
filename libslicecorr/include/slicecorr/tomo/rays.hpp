// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file tomo/rays.hpp
/// Light whose slices are not independent: rays that spread from a pinhole or fill an aperture, bent
/// by a dry vial, rising or falling on their way through the resin.
///
/// The vial turns and the light does not, so the rays of one frame are kept and all angles use them.
/// Pixels are squares, voxels are boxes, and each frame is shown while the vial turns by a step. The
/// light of a pixel's ray, in the directions th' of the resin, fills what lies between those of the
/// pixel's edges:
///   D1[v] = alpha_a dt sum_cells sum_pixels sum_rays L power p^2 / (dt' dz) sqrt(1 + slope^2) e^(-alpha l) F G,
/// p^2 the pixel's area on the plane of the axis, dt' and dz how far neighbours are apart in the
/// resin, l the way in resin to the voxel's middle, F and G the shares of the voxel that the pixel's
/// column and row meet, from side to side while the vial turns and upwards; L the mean light of the
/// pixel while the vial passes a cell of directions, in frames that are shown then and no others. A
/// takes the same weights the other way, so that A and A^T are transposes of each other. Fields are in
/// units of light times angles, as of `Projector`.
///
/// Plain values; functions are thread-safe.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <vector>

#include "slicecorr/parallel.hpp"
#include "slicecorr/process.hpp"
#include "slicecorr/tomo/projector.hpp"
#include "slicecorr/tomo/volume.hpp"

namespace slicecorr::tomo {

/// A part of the projector's image, whose pixels show the same in groups of `wide` x `high`.
struct PixelWindow {
  int first_column = 0, first_row = 0;  ///< of the projector, rows downwards from 0
  int columns = 0, rows = 0;            ///< of groups
  int wide = 1, high = 1;
  /// The middle of a group, in pixels of the projector; it may lie between two.
  double column_of(int group) const { return first_column + group * wide + 0.5 * (wide - 1); }
  double row_of(int group) const { return first_row + group * high + 0.5 * (high - 1); }
  bool operator==(const PixelWindow&) const = default;
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

/// What of its place a pixel lights, along an axis, in pixels: a box `lit` wide with all of its light,
/// blurred by a box `soft` wide (`LightBlur`).
struct PixelProfile {
  double lit = 1, soft = 0;
};

/// A share of light by the way that it has gone in the resin: 1 at `peak_mm`, 0 up to `from_mm` and from
/// `to_mm` on, linear between. Those of peaks one after another add up to 1.
struct DepthShare {
  double from_mm = -std::numeric_limits<double>::infinity(), peak_mm = 0,
         to_mm = std::numeric_limits<double>::infinity();
  /// In place of these: the shares at ways of 0, `step_mm` and so on, linear between, the last one beyond.
  std::shared_ptr<const std::vector<float>> table{};
  double step_mm = 1;

  /// Whether all light is counted, from wherever it comes.
  bool all() const { return !table && std::isinf(from_mm) && std::isinf(to_mm); }
  double at(double way_mm) const {
    if (table) {
      const double f = std::clamp(way_mm / step_mm, 0.0, static_cast<double>(table->size() - 1));
      const auto i = std::min(static_cast<std::size_t>(f), table->size() - 2);
      const double w = f - static_cast<double>(i);
      return (1 - w) * (*table)[i] + w * (*table)[i + 1];
    }
    const double end_mm = way_mm < peak_mm ? from_mm : to_mm;
    if (std::isinf(end_mm)) return 1;
    return std::max(0.0, (end_mm - way_mm) / (end_mm - peak_mm));
  }
};

/// All rays of one frame.
struct LabRays {
  int columns = 0, rows = 0;  ///< rows upwards, the lowest first
  int per_pixel = 1;
  double pixel_area_mm2 = 0;  ///< of a group of pixels, on the plane of the axis without the vial
  double alpha_per_mm = 0;    ///< along the way
  double vial_mm = 0;         ///< inner radius
  PixelProfile across, up;    ///< of a pixel (a group of them), along columns and rows
  DepthShare depth;           ///< of the light that is to be counted
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
/// and columns; the same bytes for any number of threads. A voxel is dark where the ray to its middle
/// meets an opaque voxel (coverage > 0) of `insert`, which has this grid. Throws `InputError` for a grid
/// that does not fit, and for one row of pixels.
std::unique_ptr<Projector> make_ray_projector(const TomoGrid& grid, const LabRays& rays,
                                              const Volume* insert = nullptr);

}  // namespace slicecorr::tomo
