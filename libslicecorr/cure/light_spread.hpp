// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Light that spreads sideways: at the window, as printers have it (`LightSpread`), and with depth,
/// as resins scatter it.
///
/// Fields are doubles over boxes of pixels, row by row, and 0 outside of their box: beyond the
/// display it is dark, and what spreads past its edge is lost, not reflected. Light is intensity,
/// never grey levels. Boxes may reach beyond the display, coordinates may be negative.
///
/// At the window each weight is the integral of the spread over a pixel; sampled it would be wrong
/// where sigma is below some 0.7 pixels. Scatter makes the variance grow with depth, sigma²(d) =
/// sigma0² + kappa d, so Gaussians of depths add up and the dose of slices follows from one to the
/// next: Omega(k) = (1 - a) G phi(k) + a K Omega(k + 1), a = 10^(-hs/ha), K of variance kappa hs. G is
/// what a slice gives its own node: G0 where nothing scatters, else `scattering_blur`.
#pragma once

#include <cstddef>
#include <limits>
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
  static LightBlur of_weights(std::vector<double> weights, int reach_x, int reach_y);

  /// What light over `from` gives over `to`. Each pixel is the same sum in the same order whatever
  /// the boxes, so bands with a halo of `reach_y()` rows give the bits of the whole image. `in` and
  /// `out` must not overlap.
  void apply(const double* in, const PixelBox& from, double* out, const PixelBox& to) const;
  /// Its transpose: what `to` answers for, gathered over `from`.
  void apply_transposed(const double* in, const PixelBox& from, double* out,
                        const PixelBox& to) const;

 private:
  struct Part {
    std::vector<double> x, y;  ///< y has the weight of the part, too
  };
  void take(std::vector<double> weights);
  void apply_measured(const std::vector<double>& taps, const double* in, const PixelBox& from,
                      double* out, const PixelBox& to) const;

  int reach_x_ = 0, reach_y_ = 0;
  std::vector<Part> parts_;
  /// Row by row, (2 reach_y_ + 1) x (2 reach_x_ + 1): what a pixel takes from those around it; and
  /// the same turned by half a turn.
  std::vector<double> measured_, measured_transposed_;
};

/// The spread that light gains from one slice to the next, K; symmetric, so its own transpose.
/// Immutable; may be shared between threads.
class SliceScatter {
 public:
  /// No scatter.
  SliceScatter() = default;
  /// `scatter_um2_per_um` as `Resin::scatter_um2_per_um`.
  SliceScatter(double scatter_um2_per_um, double slice_um, double pixel_x_um, double pixel_y_um);

  bool none() const { return steps_ == 0; }
  /// Light goes so many pixels to either side in a slice and no further.
  int steps() const { return steps_; }
  /// In place, over a box whose surroundings count as 0.
  void apply(double* field, const PixelBox& box) const;
  /// So many pixels beyond what is looked at, a field that is left out there changes a dose by at
  /// most `share` of the greatest dose left out. `kept` is a, what is left of light after a slice.
  /// With e^(-q x) for x pixels: a^(1/n) (1 - 2 w + 2 w cosh q) = 1 bounds what errors become.
  int halo_x(double kept, double share) const { return halo(w_x_, kept, share); }
  int halo_y(double kept, double share) const { return halo(w_y_, kept, share); }

 private:
  int halo(double w, double kept, double share) const;

  /// K is `steps_` times the taps (w, 1 - 2 w, w) along each axis, w <= 1/4: these have the variance
  /// exactly and are nowhere negative.
  int steps_ = 0;
  double w_x_ = 0, w_y_ = 0;
};

/// How light goes through a slice of a resin that scatters it.
struct ScatterWay {
  double um2_per_um = 0;   ///< as `Resin::scatter_um2_per_um`
  double height_e_um = 0;  ///< absorbance height
  double slice_um = 0;
  bool layerwise = false;  ///< the window stands a slice away, it does not come up to the node
  double pixel_x_um = 0, pixel_y_um = 0;
};

/// The G of a resin that scatters: light of pixels that are squares, not points, and which scatters in
/// their own slice, too. A slice further away counts for K once more; so G is what makes the sum of all
/// slices that of the depths themselves, T = the integral of G0 and Gaussians of kappa d over the
/// pixel: G = (T - a K T) / (1 - a). Beside what goes straight down doses are then exact in pixels'
/// middles; below an end of a wall they are off by up to 0.016 of its dose. Of a measured spread, which
/// has its pixels in it, the variance of the own slice is added alone. A few weights may be below 0.
LightBlur scattering_blur(const LightSpread& spread, const ScatterWay& way,
                          const Turn& to_display = {});

/// How the light of slices at some distances spreads on its way to a node: those from `from` slices
/// further on (0: the node's own) up to `to` slices, exclusive.
struct DistanceBlur {
  int from = 0, to = 0;
  LightBlur blur{};
};

/// The kernel by depth of a resin that scatters, right also where light begins and ends, and for any m: light
/// that has come through d um is G0 and a Gaussian of kappa d, integrated over pixels, and what the
/// slices of a distance give is that of their depths, weighted as light fades. Distances share a kernel where
/// that changes doses by 2e-3 at the most. The first is
/// a slice's own, and each begins where the one before it ends. `bath`: slices from which no light comes
/// any more; 0: there is no end, and the last distance has none (`kNoEnd`). Empty without scatter.
inline constexpr int kNoEnd = std::numeric_limits<int>::max();
std::vector<DistanceBlur> distance_blurs(const LightSpread& spread, const ScatterWay& way, int bath,
                                         const Turn& to_display = {});

/// The relative dose over `window` of linear light (m = 1), slice by slice from the last to the
/// first. For one thread at a time; spread and scatter must outlive it.
class SpreadDose {
 public:
  /// Each light is given over `shown`. With scatter, what is seen of `window` is right but for its
  /// outer rows and columns: see `SliceScatter::halo_y`.
  SpreadDose(const LightBlur& blur, const SliceScatter& scatter, double kept, const PixelBox& shown,
             const PixelBox& window);
  /// The slice before the last one that was added shows `light`, relative so that 1 everywhere
  /// gives a dose of 1 in the end; null: dark. Dose at its node, over `window`.
  const std::vector<double>& add(const double* light);
  /// The light of the slice that was added last with which each column alone has the same dose at
  /// its node, (1 - a) light + a Omega(k + 1): what models of columns need to know of the others.
  /// With scatter it may be below 0, beside light that is lost.
  const std::vector<double>& column_light() const { return column_light_; }

 private:
  const LightBlur& blur_;
  const SliceScatter& scatter_;
  double kept_;
  PixelBox shown_, window_;
  std::vector<double> dose_, column_light_, below_;
};

/// The transpose of `SpreadDose`: slices from the first to the last, weights over `window` in, the
/// change of their sum of products with the doses per light over `shown` out.
class SpreadDoseTransposed {
 public:
  SpreadDoseTransposed(const LightBlur& blur, const SliceScatter& scatter, double kept,
                       const PixelBox& shown, const PixelBox& window);
  const std::vector<double>& add(const double* weights);

 private:
  const LightBlur& blur_;
  const SliceScatter& scatter_;
  double kept_;
  PixelBox shown_, window_;
  std::vector<double> sum_, gradient_;
};

}  // namespace slicecorr::detail
