// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file tomo/light_blur.hpp
/// How far the light of a pixel goes sideways before it comes to a voxel: by the projector's optics
/// (`Printer::spread`) and, the deeper the more, by the resin (`Resin::scatter_um2_per_um`).
///
/// Light that goes sideways by a Gaussian is that of a blurred image: the dose is
///   D = sum over i of c_i(l) P K_i b,
/// b the image of a frame, K_i its blur by one variance, c_i the share of this variance at the way l in
/// the resin (hats over l, which add up to 1), P what sharp pixels leave. K_i is cut at the image's border,
/// where the light of the image ends. Gaussians are even, so their own transpose. A measured picture
/// (`LightSpread::picture`) is a sum of products of numbers along columns and rows, by its singular
/// values, with the scatter of the resin in them; its transpose is that of the picture turned round.
///
/// On pixels a Gaussian of variance v (in pixels squared) is taken apart: boxes, by which pixels become
/// softer and which footprints have in closed form, hold up to 1/6 of v; numbers at whole pixels hold
/// the rest. So a weight is right to 0.02 and better, for pixels as large as voxels.
///
/// Plain values; thread-safe.
#pragma once

#include <vector>

#include "slicecorr/tomo/rays.hpp"

namespace slicecorr::tomo {

/// A sum of blurs on whole pixels, each along columns and rows alone: numbers of the middle one and of
/// those to each side of it, or, where they are not `even`, an odd number of them from the first to the last.
struct ImageBlur {
  struct Gaussian {
    double weight = 1;
    std::vector<float> columns = {1}, rows = {1};  ///< to the right, and upwards
    bool even = true;
  };
  std::vector<Gaussian> sum;  ///< weights add up to 1; empty: none
  bool none() const { return sum.empty(); }
};

/// Light of one variance: one term of the sum above.
struct BlurredLight {
  PixelProfile across, up;
  DepthShare depth;
  ImageBlur blur;
};

}  // namespace slicecorr::tomo
