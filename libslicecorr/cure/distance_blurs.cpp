// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "cure/distance_blurs.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>

#include "cure/shown_slices.hpp"

namespace slicecorr::detail {

namespace {

/// What of a kernel may be left out.
constexpr double kWeightLeftOut = 1e-6;

/// A depth, and what of all light comes from there.
struct Depth {
  double um, share;
};

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
  return LightBlur::of_weights(weights, reach_x, reach_y);
}

/// Lets the variance of a field grow. So many times the weights (w, 1 - 2 w, w) along each axis, w <= 1/4:
/// these have the variance exactly and are nowhere negative.
void diffuse(std::vector<double>& field, const PixelBox& box, double variance_um2,
             const ScatterWay& way) {
  double w_x = variance_um2 / (2 * way.pixel_x_um * way.pixel_x_um),
         w_y = variance_um2 / (2 * way.pixel_y_um * way.pixel_y_um);
  const int steps = std::max(1, static_cast<int>(std::ceil(4 * std::max(w_x, w_y))));
  w_x /= steps;
  w_y /= steps;
  const auto width = static_cast<std::size_t>(box.width());
  std::vector<double> rows(field.size());
  for (int step = 0; step < steps; ++step) {
    for (std::size_t i = 0; i < field.size(); ++i) {
      const double left = i % width > 0 ? field[i - 1] : 0,
                   right = i % width + 1 < width ? field[i + 1] : 0;
      rows[i] = (1 - 2 * w_x) * field[i] + w_x * (left + right);
    }
    for (std::size_t i = 0; i < field.size(); ++i) {
      const double above = i >= width ? rows[i - width] : 0,
                   below = i + width < rows.size() ? rows[i + width] : 0;
      field[i] = (1 - 2 * w_y) * rows[i] + w_y * (above + below);
    }
  }
}

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
    const double sigma_um = std::sqrt(way.um2_per_um * mean_um);
    const auto more = [&](double pixel_um) {
      return static_cast<int>(gaussian_taps(sigma_um, pixel_um).size());
    };
    const PixelBox box = box_around(window.reach_x() + more(way.pixel_x_um),
                                    window.reach_y() + more(way.pixel_y_um));
    std::vector<double> field(columns_of(box));
    const double one = 1;
    window.apply(&one, {0, 0, 1, 1}, field.data(), box);
    diffuse(field, box, way.um2_per_um * mean_um, way);
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
