// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "cure/light_spread.hpp"

namespace slicecorr::detail {

namespace {

/// What of G may be left out.
constexpr double kWeightLeftOut = 1e-6;
/// G is seen no further from the pixel than the light of its own slice, and so much more: beyond, K of
/// all slices is as good as Gaussians.
constexpr int kBeyond = 12;
/// Depths, in roots of absorbance heights, by Simpson's rule; the last leaves 1e-10 of light out.
constexpr int kDepths = 400;
constexpr double kDeepest = 4.8;

std::size_t area_of(const PixelBox& box) {
  return static_cast<std::size_t>(box.width()) * static_cast<std::size_t>(box.height());
}

struct Depth {
  double um, share;
};

/// From how deep the light of a node comes; shares add up to 1.
std::vector<Depth> depths_of(const ScatterWay& way) {
  std::vector<Depth> depths;
  double sum = 0;
  const auto add = [&](double um, double share) {
    depths.push_back({um, share});
    sum += share;
  };
  if (way.layerwise) {
    const double a = std::exp(-way.slice_um / way.height_e_um);
    double share = 1;
    for (int j = 1; share > 1e-10; ++j, share *= a) add(j * way.slice_um, share);
  } else {
    for (int i = 1; i <= kDepths; ++i) {
      const double t = i * kDeepest / kDepths;
      add(way.height_e_um * t * t, (i % 2 ? 4 : 2) * t * std::exp(-t * t));
    }
  }
  for (Depth& d : depths) d.share /= sum;
  return depths;
}

/// The mean depth that light of a slice has crossed at its own node.
double own_depth_um(const ScatterWay& way) {
  if (way.layerwise) return way.slice_um;
  return way.height_e_um - way.slice_um / std::expm1(way.slice_um / way.height_e_um);
}

/// Weights of a Gaussian integrated over pixels, from the middle outwards to `reach`.
std::vector<double> pixel_weights(double variance_um2, double pixel_um, int reach) {
  std::vector<double> weights(static_cast<std::size_t>(reach) + 1, 0.0);
  if (!(variance_um2 > 0)) {
    weights[0] = 1;
    return weights;
  }
  const double per_pixel = pixel_um / std::sqrt(2 * variance_um2);
  double near = std::erfc(0.5 * per_pixel);
  weights[0] = 1 - near;
  for (int k = 1; k <= reach && near > 0; ++k) {
    const double far = std::erfc((k + 0.5) * per_pixel);
    weights[static_cast<std::size_t>(k)] = (near - far) / 2;
    near = far;
  }
  return weights;
}

/// Adds products of weights along both axes over a box around a pixel at 0, 0.
void add_products(const std::vector<double>& x, const std::vector<double>& y, const PixelBox& box,
                  std::vector<double>& out) {
  std::size_t at = 0;
  for (int j = box.y0; j < box.y1; ++j) {
    const double row = y[static_cast<std::size_t>(std::abs(j))];
    for (int i = box.x0; i < box.x1; ++i)
      out[at++] += row * x[static_cast<std::size_t>(std::abs(i))];
  }
}

PixelBox box_around(int x, int y) { return {-x, -y, x + 1, y + 1}; }

/// A field around a pixel, cut to the columns and rows that have any weight to speak of.
LightBlur cut_down(const std::vector<double>& field, const PixelBox& box) {
  int reach_x = 0, reach_y = 0;
  std::size_t at = 0;
  for (int y = box.y0; y < box.y1; ++y) {
    for (int x = box.x0; x < box.x1; ++x, ++at) {
      if (std::abs(field[at]) < kWeightLeftOut) continue;
      reach_x = std::max(reach_x, std::abs(x));
      reach_y = std::max(reach_y, std::abs(y));
    }
  }
  std::vector<double> weights;
  double sum = 0;
  at = 0;
  for (int y = box.y0; y < box.y1; ++y) {
    for (int x = box.x0; x < box.x1; ++x, ++at) {
      if (std::abs(x) > reach_x || std::abs(y) > reach_y) continue;
      weights.push_back(field[at]);
      sum += field[at];
    }
  }
  for (double& w : weights) w /= sum;
  return LightBlur::of_weights(std::move(weights), reach_x, reach_y);
}

}  // namespace

LightBlur scattering_blur(const LightSpread& spread, const ScatterWay& way,
                          const Turn& to_display) {
  if (!(way.um2_per_um > 0)) return {spread, way.pixel_x_um, way.pixel_y_um, to_display};
  const double own_um = own_depth_um(way);
  if (spread.picture) {
    const LightBlur window(spread, way.pixel_x_um, way.pixel_y_um, to_display);
    const SliceScatter own(way.um2_per_um, own_um, way.pixel_x_um, way.pixel_y_um);
    const PixelBox box = box_around(window.reach_x() + kBeyond, window.reach_y() + kBeyond);
    std::vector<double> field(area_of(box));
    const double one = 1;
    window.apply(&one, {0, 0, 1, 1}, field.data(), box);
    own.apply(field.data(), box);
    return cut_down(field, box);
  }
  std::vector<SpreadGaussian> gaussians = spread.gaussians;
  if (spread.none()) gaussians = {{0, 1}};
  double weights = 0, widest = 0;
  for (const SpreadGaussian& g : gaussians) {
    weights += g.weight;
    widest = std::max(widest, g.sigma_um);
  }
  const double reach_um = std::sqrt(widest * widest + way.um2_per_um * way.slice_um);
  const auto reach = [&](double pixel_um) {
    return static_cast<int>(gaussian_taps(reach_um, pixel_um).size()) - 1 + kBeyond;
  };
  const SliceScatter next(way.um2_per_um, way.slice_um, way.pixel_x_um, way.pixel_y_um);
  const int x = reach(way.pixel_x_um), y = reach(way.pixel_y_um);
  // K looks so much further.
  const PixelBox box = box_around(x + next.steps(), y + next.steps());
  std::vector<double> all(area_of(box), 0.0);
  for (const SpreadGaussian& g : gaussians) {
    for (const Depth& d : depths_of(way)) {
      const double variance = g.sigma_um * g.sigma_um + way.um2_per_um * d.um;
      std::vector<double> along_x = pixel_weights(variance, way.pixel_x_um, box.x1);
      for (double& w : along_x) w *= d.share * g.weight / weights;
      add_products(along_x, pixel_weights(variance, way.pixel_y_um, box.y1), box, all);
    }
  }
  std::vector<double> shifted = all;
  next.apply(shifted.data(), box);
  const double kept = std::exp(-way.slice_um / way.height_e_um);
  for (std::size_t i = 0; i < all.size(); ++i) all[i] = (all[i] - kept * shifted[i]) / (1 - kept);
  // The outermost were spread without what lies beyond them.
  std::size_t at = 0;
  for (int j = box.y0; j < box.y1; ++j) {
    for (int i = box.x0; i < box.x1; ++i, ++at) {
      if (std::abs(i) > x || std::abs(j) > y) all[at] = 0;
    }
  }
  return cut_down(all, box);
}

}  // namespace slicecorr::detail
