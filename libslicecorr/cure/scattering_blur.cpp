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

namespace {

/// Distances share a kernel where what sigma² gains in them, over sigma², times their share of a dose is no
/// more. Light that ends among them has another sigma than they have together, by a quarter of the first at the
/// most, and a straight edge is off by 0.242 of that: 2e-3 of a dose.
constexpr double kShared = 0.033;
/// Deviation of sigma² among distances, over sigma², up to which one kernel stands for all of them.
constexpr double kOneKernel = 0.1;
/// Rules for integrals over 0..1, and over 0.. with the weight e^-x: those of Gauss and of Laguerre.
constexpr Depth kWithin[] = {{0.0694318442, 0.1739274226},
                             {0.3300094782, 0.3260725774},
                             {0.6699905218, 0.3260725774},
                             {0.9305681558, 0.1739274226}};
constexpr Depth kBeyondAll[] = {
    {0.4157745568, 0.7110930099}, {2.2942803603, 0.2785177336}, {6.2899450829, 0.0103892565}};

/// Depths with the mean and the variance of those from `from` to `to` slices: two, or one where sigma², which is
/// `window_um2` at the window, hardly differs among them.
std::vector<Depth> mean_depths(const ScatterWay& way, int from, int to, double window_um2) {
  double sum = 0, mean = 0, square = 0;
  const int steps = way.layerwise ? to - from : 16 * (to - from);
  const double step_um = (to - from) * way.slice_um / steps;
  for (int i = 0; i < steps; ++i) {
    const double um = from * way.slice_um + (i + (way.layerwise ? 1.0 : 0.5)) * step_um;
    const double share = std::exp(-um / way.height_e_um);
    sum += share;
    mean += share * um;
    square += share * um * um;
  }
  mean /= sum;
  const double off = std::sqrt(std::max(0.0, square / sum - mean * mean));
  if (way.um2_per_um * off <= kOneKernel * (window_um2 + way.um2_per_um * mean)) return {{mean, 1}};
  return {{mean - off, 0.5}, {mean + off, 0.5}};
}

/// From how deep the light of slices at some distances comes; shares add up to 1.
std::vector<Depth> depths_between(const ScatterWay& way, int from, int to, double window_um2) {
  std::vector<Depth> depths;
  if (to == kNoEnd) {
    const double a = std::exp(-way.slice_um / way.height_e_um);
    const double begin_um = (from + (way.layerwise ? 1 : 0)) * way.slice_um;
    const double mean_um = way.layerwise ? way.slice_um * a / (1 - a) : way.height_e_um;
    for (const Depth& rule : kBeyondAll)
      depths.push_back({begin_um + rule.um * mean_um, rule.share});
    return depths;
  }
  if (from > 0 || way.layerwise) return mean_depths(way, from, to, window_um2);
  // What spreads goes with the root of the depth.
  double sum = 0;
  for (const Depth& rule : kWithin) {
    const double um = way.slice_um * to * rule.um * rule.um;
    const double share = rule.share * rule.um * std::exp(-um / way.height_e_um);
    depths.push_back({um, share});
    sum += share;
  }
  for (Depth& d : depths) d.share /= sum;
  return depths;
}

LightBlur blur_through(const LightSpread& spread, const ScatterWay& way,
                       const std::vector<Depth>& depths, const Turn& to_display) {
  if (spread.picture) {
    double mean_um = 0;
    for (const Depth& d : depths) mean_um += d.share * d.um;
    const LightBlur window(spread, way.pixel_x_um, way.pixel_y_um, to_display);
    const SliceScatter through(way.um2_per_um, mean_um, way.pixel_x_um, way.pixel_y_um);
    const double sigma_um = std::sqrt(way.um2_per_um * mean_um);
    const auto more = [&](double pixel_um) {
      return static_cast<int>(gaussian_taps(sigma_um, pixel_um).size());
    };
    const PixelBox box = box_around(window.reach_x() + more(way.pixel_x_um),
                                    window.reach_y() + more(way.pixel_y_um));
    std::vector<double> field(area_of(box));
    const double one = 1;
    window.apply(&one, {0, 0, 1, 1}, field.data(), box);
    through.apply(field.data(), box);
    return cut_down(field, box);
  }
  LightSpread there;
  const std::vector<SpreadGaussian> none{{0, 1}};
  for (const SpreadGaussian& g : spread.none() ? none : spread.gaussians) {
    for (const Depth& d : depths) {
      there.gaussians.push_back(
          {std::sqrt(g.sigma_um * g.sigma_um + way.um2_per_um * d.um), g.weight * d.share});
    }
  }
  return {there, way.pixel_x_um, way.pixel_y_um};
}

}  // namespace

std::vector<DistanceBlur> distance_blurs(const LightSpread& spread, const ScatterWay& way, int bath,
                                         const Turn& to_display) {
  std::vector<DistanceBlur> all;
  if (!(way.um2_per_um > 0)) return all;
  double pixel_um = std::min(way.pixel_x_um, way.pixel_y_um), sigma_um = 0;
  if (!spread.none() && !spread.picture) {
    sigma_um =
        std::min_element(spread.gaussians.begin(), spread.gaussians.end(),
                         [](const auto& a, const auto& b) { return a.sigma_um < b.sigma_um; })
            ->sigma_um;
  }
  const double at_window = sigma_um * sigma_um + pixel_um * pixel_um / 12;
  const int end = bath > 0 ? bath : kNoEnd;
  for (int from = 0; from < end;) {
    int to = from + 1;
    if (from > 0) {
      const double um = from * way.slice_um, per_um = 1 / (at_window / way.um2_per_um + um);
      const auto together = [&](double more_um) {
        return more_um * per_um * std::exp(-um / way.height_e_um) *
                   -std::expm1(-more_um / way.height_e_um) <=
               kShared;
      };
      // Of all that is further away most comes from within an absorbance height or two.
      if (together(2 * way.height_e_um)) to = end;
      while (to < end && together((to + 1 - from) * way.slice_um)) ++to;
    }
    all.push_back(
        {from, to,
         blur_through(spread, way, depths_between(way, from, to, at_window), to_display)});
    from = to;
  }
  return all;
}

}  // namespace slicecorr::detail
