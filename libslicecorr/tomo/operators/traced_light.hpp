// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Which voxels the light of a pixel falls on, of light that is traced (vial_trace.hpp): strips of light
/// between two rays, which are cut where their rays meet different faces, and the share of a voxel that
/// lies in a strip.
///
/// Rays of pixels above each other go nearly alike, seen from above, where they rise nearly alike: they are
/// one bundle, and how high each of them is on its way is exact but for what they differ in.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <vector>

#include "slicecorr/tomo/projector.hpp"
#include "slicecorr/tomo/rays.hpp"
#include "slicecorr/tomo/volume.hpp"
#include "tomo/operators/vial_trace.hpp"

namespace slicecorr::tomo::detail {

/// Rows of pixels whose rays through the same place of the aperture go alike, seen from above.
struct TracedBundle {
  int first_row = 0, end_row = 1;  ///< rows of the grid's light, upwards
  int ray = 0;                     ///< of a pixel
  double middle_row() const { return 0.5 * (first_row + end_row - 1); }
};

/// Light that rises, falls or spreads on its way: a pixel's rays.
struct TracedRows {
  Printer printer;
  PixelWindow window;
  std::vector<AperturePoint> points;  ///< where rays cross the aperture
  double aperture = 0;                ///< slope of its edge against the middle ray
  double row_mm = 1;                  ///< from one row (a group of them) to the next, in the image
  double lit = 1;                     ///< share of it that is lit
  /// Of any place in the image: columns and rows of the grid's light, rows upwards.
  TracedLine line(double column, double row, int ray) const;
};

/// Columns of pixels across the image, and the vial that their light comes into.
struct TracedLight {
  VialTrace vial;
  double first_mm = 0;     ///< X of the middle of the first pixel (a group of them)
  double pitch_mm = 1;     ///< from one to the next
  double lit = 1;          ///< share of it that is lit
  double transmitted = 1;  ///< what a bath's window lets through
  /// Of the grid's columns of voxels, [y][x]: whether resin is in the middle.
  std::vector<bool> resin;
  std::shared_ptr<const TracedRows> rows;  ///< null: light is level
  /// Of level light one, of all slices.
  std::vector<TracedBundle> bundles{TracedBundle{}};

  TracedLine line(double column, const TracedBundle& bundle) const {
    if (rows) return rows->line(column, bundle.middle_row(), bundle.ray);
    return {first_mm + column * pitch_mm, 0, 0, 0, transmitted};
  }
};

/// Bundles of a grid's rows, such that seen from above no ray is farther than a tenth of a voxel from its
/// bundle's, times `narrower`.
std::vector<TracedBundle> bundles_of(const TomoGrid& grid, const TracedRows& rows,
                                     double narrower = 1);

/// Resin in the columns of voxels of a grid.
std::vector<bool> resin_of(const Vial& vial, const TomoGrid& grid);

/// A voxel that gets light: its column, and how much of the pixel's, as `Projector` counts it. Where light
/// rises: of all of its row, and how far it has risen (`TracedPiece::rise_mm`).
struct TracedShare {
  int x = 0, y = 0;
  double share = 0, rise_mm = 0;
};

/// Strips of all light while the vial stands turned by `th`.
class TracedStrips {
 public:
  /// `side_mm`: of voxels, as they are judged; 0: their middles. `turn_rad`: by how much the vial turns
  /// meanwhile.
  TracedStrips(const TomoGrid& grid, const TracedLight& light, double side_mm, double turn_rad);

  /// Calls use for the voxels that get light of a pixel's bundle.
  void of_pixel(double th, int pixel, const TracedBundle& bundle,
                const std::function<void(const TracedShare&)>& use) const;

 private:
  struct Strip;
  TracedRay ray(const Strip& strip, double column) const;
  void add(const Strip& strip, int depth, const std::function<void(const TracedShare&)>& use) const;

  const TomoGrid& grid_;
  const TracedLight& light_;
  double side_mm_, turn_rad_;
};

/// What light of a pixel a column of voxels gets.
struct TracedWeight {
  std::uint16_t x = 0, y = 0, pixel = 0;
  float share = 0, rise_mm = 0;
};
/// Of a bundle, the mean over these angles of the vial: row of voxels by row, in each from one column of voxels
/// to the next.
std::vector<TracedWeight> weights_of(const TracedStrips& strips, const TomoGrid& grid,
                                     const TracedBundle& bundle, const std::vector<double>& turns);
/// Angles that stand for the step of frame m.
std::vector<double> turns_of_frame(const TomoGrid& grid, int m);

/// Memory of all weights, nearly.
double bytes_of_weights(const TomoGrid& grid, const TracedLight& light);

/// The pair of operators. Throws `InputError` where its weights take more memory than `kMostTracedBytes`.
inline constexpr double kMostTracedBytes = 8e9;
std::unique_ptr<Projector> make_traced_projector(const TomoGrid& grid, const TracedLight& light);
/// That of light that rises.
std::unique_ptr<Projector> make_rising_projector(const TomoGrid& grid, const TracedLight& light);

/// Of the part of the turn that a frame is shown for: angles that stand for it, so that light moves by at
/// most half a voxel from one to the next.
int traced_angles(const TomoGrid& grid, double step_rad);

}  // namespace slicecorr::tomo::detail
