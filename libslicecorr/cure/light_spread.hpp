// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Light that spreads sideways at the window, as printers have it (`LightSpread`). How resin scatters it
/// on its way is in `distance_blurs.hpp`.
///
/// Fields are doubles over boxes of pixels, row by row, and 0 outside of their box: beyond the
/// display it is dark, and what spreads past its edge is lost, not reflected. Light is intensity,
/// never grey levels. Boxes may reach beyond the display, coordinates may be negative.
///
/// Each weight is the integral of the spread over a pixel; sampled it would be wrong where sigma is below
/// some 0.7 pixels.
#pragma once

#include <vector>

#include "slicecorr/grid.hpp"
#include "slicecorr/orientation.hpp"
#include "slicecorr/process.hpp"

namespace slicecorr::detail {

/// Weights of a Gaussian along one axis, from the middle outwards: each integrated over a pixel,
/// cut where less than 1e-6 is left on both sides together, and scaled so that all, of both sides,
/// add up to 1. {1} for a sigma of 0.
std::vector<double> gaussian_taps(double sigma_um, double pixel_um);

/// The share of the light of a long thin line, along the rows of the display (`rows`) or its columns,
/// that falls within `x_um` of its middle to one side, 0..1/2; of a measured spread the mean of both
/// sides.
double share_beside_line(const LightSpread& spread, bool rows, double x_um);

/// The finest line and gap in um, see FinestPrint: of light `full` and `black` after many slices,
/// full > 1 > black.
struct FinestWidths {
  double line_um = 0, gap_um = 0;
};
FinestWidths finest_widths(const LightSpread& spread, bool rows, double full, double black);

/// The spread of light at the window, in pixels of one grid. Immutable; may be shared between
/// threads.
class LightBlur {
 public:
  /// No spread.
  LightBlur() = default;
  /// `pixel_x_um` and `pixel_y_um` are of the images that are blurred. `to_display` turns those into
  /// what the display shows, as which a measured spread lies.
  LightBlur(const LightSpread& spread, double pixel_x_um, double pixel_y_um,
            const Turn& to_display = {});

  bool none() const { return parts_.empty() && measured_.empty(); }
  /// Light goes so many pixels to either side and no further.
  int reach_x() const { return reach_x_; }
  int reach_y() const { return reach_y_; }

  /// The spread that gives to the pixels around one what `weights` say, row by row, (2 reach_y + 1) x
  /// (2 reach_x + 1).
  static LightBlur of_weights(const std::vector<double>& weights, int reach_x, int reach_y);

  /// What light over `from` gives over `to`. Each pixel is the same sum in the same order whatever
  /// the boxes, so bands with a halo of `reach_y()` rows give the bits of the whole image. `in` and
  /// `out` must not overlap.
  void apply(const double* in, const PixelBox& from, double* out, const PixelBox& to) const;

 private:
  struct Part {
    std::vector<double> x, y;  ///< y has the weight of the part, too
  };
  void apply_measured(const double* in, const PixelBox& from, double* out,
                      const PixelBox& to) const;

  int reach_x_ = 0, reach_y_ = 0;
  std::vector<Part> parts_;
  /// Row by row, (2 reach_y_ + 1) x (2 reach_x_ + 1): what a pixel takes from those around it.
  std::vector<double> measured_;
};

}  // namespace slicecorr::detail
