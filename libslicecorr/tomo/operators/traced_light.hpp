// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Which voxels the light of a pixel falls on, of level light that is traced (vial_trace.hpp): strips
/// of light between two rays, which are cut where their rays meet different faces, and the share of a
/// voxel that lies in a strip.
#pragma once

#include <functional>
#include <memory>
#include <vector>

#include "slicecorr/tomo/projector.hpp"
#include "slicecorr/tomo/volume.hpp"
#include "tomo/operators/vial_trace.hpp"

namespace slicecorr::tomo::detail {

/// Columns of pixels across the image, and the vial that their light comes into.
struct TracedLight {
  VialTrace vial;
  double first_mm = 0;     ///< X of the middle of the first pixel (a group of them)
  double pitch_mm = 1;     ///< from one to the next
  double lit = 1;          ///< share of it that is lit
  double transmitted = 1;  ///< what a bath's window lets through
  /// Of the grid's columns of voxels, [y][x]: whether resin is in the middle.
  std::vector<bool> resin;
};

/// Resin in the columns of voxels of a grid.
std::vector<bool> resin_of(const Vial& vial, const TomoGrid& grid);

/// The ray at X, while the vial stands turned by `th`.
TracedRay traced_ray(const VialTrace& vial, double th, double x_mm);

/// A voxel that gets light: its column, and how much of the pixel's, as `Projector` counts it.
struct TracedShare {
  int x = 0, y = 0;
  double share = 0;
};

/// Strips of all light while the vial stands turned by `th`.
class TracedStrips {
 public:
  /// `side_mm`: of voxels, as they are judged; 0: their middles. `turn_rad`: by how much the vial turns
  /// meanwhile.
  TracedStrips(const TomoGrid& grid, const TracedLight& light, double side_mm, double turn_rad);

  /// Calls use(x, y, share) for the voxels that get light of a pixel.
  void of_pixel(double th, int pixel, const std::function<void(const TracedShare&)>& use) const;

 private:
  struct Strip;
  void add(const Strip& strip, int depth, const std::function<void(const TracedShare&)>& use) const;

  const TomoGrid& grid_;
  const TracedLight& light_;
  double side_mm_, turn_rad_;
};

/// Memory of all weights, nearly.
double bytes_of_weights(const TomoGrid& grid, const TracedLight& light);

/// The pair of operators. Throws `InputError` where its weights take more memory than `kMostTracedBytes`.
inline constexpr double kMostTracedBytes = 8e9;
std::unique_ptr<Projector> make_traced_projector(const TomoGrid& grid, const TracedLight& light);

/// Of the part of the turn that a frame is shown for: angles that stand for it, so that light moves by at
/// most half a voxel from one to the next.
int traced_angles(const TomoGrid& grid, double step_rad);

}  // namespace slicecorr::tomo::detail
