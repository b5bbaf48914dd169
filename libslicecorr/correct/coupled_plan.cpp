// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "correct/coupled_plan.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "correct/coupled_kernels.hpp"
#include "slicecorr/error.hpp"

namespace slicecorr::detail {

namespace {

/// Weights below this share of the middle one are left out of the choice of light (not of doses).
constexpr double kNearShare = 0.05;
/// And those of pixels that are worth a try.
constexpr double kTryShare = 0.3;
/// No choice looks further: pixels beyond are left to later slices and rounds.
constexpr int kMostNear = 7;
/// With more levels than these the errors of rounding don't show in the plane.
constexpr int kFewLevels = 16;

/// What lies in the middle of a box that is lit on some sides of it only.
class LitPart {
 public:
  LitPart(const CureModel& model, const LightBlur& blur, const std::vector<DistanceBlur>& distances)
      : model_(model), blur_(blur), distances_(distances) {
    int x = blur.reach_x(), y = blur.reach_y();
    for (const DistanceBlur& d : distances) {
      x = std::max(x, d.blur.reach_x());
      y = std::max(y, d.blur.reach_y());
    }
    box_ = {-x, -y, x + 1, y + 1};
  }
  /// Slices of full light, `most` at the most, after which the pixel in the middle gels; `lit` tells
  /// which pixels are. 0: its light does not do for that.
  template <class Lit>
  int slices_to_gel(int most, const Lit& lit) const {
    const double m = model_.m;
    const double full = std::pow(model_.phi_max(), 1 / m),
                 black = std::pow(model_.phi_min(), 1 / m);
    std::vector<double> shown;
    for (int y = box_.y0; y < box_.y1; ++y) {
      for (int x = box_.x0; x < box_.x1; ++x) shown.push_back(lit(x, y) ? full : black);
    }
    if (!distances_.empty()) return slices_to_gel_by_distance(most, shown);
    double light = 0, dose = 0;
    blur_.apply(shown.data(), box_, &light, kMiddle);
    light = m == 1 ? light : std::pow(std::max(0.0, light), m);
    if (light <= 1) return 0;
    // Light of slices beyond the bath's end does nothing more.
    const int bath = model_.bath_slices;
    // Slices after the last one are as high as it.
    constexpr int last = std::numeric_limits<int>::max();
    for (int k = 1; k < most; ++k) {
      if (bath > 0 && k > bath) return 0;
      dose = model_.step_in(last, light, dose);
      if (dose >= 1) return k;
    }
    return most;
  }

 private:
  static constexpr PixelBox kMiddle{0, 0, 1, 1};
  int slices_to_gel_by_distance(int most, const std::vector<double>& shown) const {
    double dose = 0, all = 0;
    int gels = 0;
    for (const DistanceBlur& d : distances_) {
      double light = 0;
      d.blur.apply(shown.data(), box_, &light, kMiddle);
      light = std::pow(std::max(0.0, light), model_.m);
      const double left = std::pow(model_.a, d.from);
      all += light * (d.to == kNoEnd ? left : left - std::pow(model_.a, d.to));
      for (int j = d.from; j < std::min(d.to, most) && gels == 0; ++j) {
        dose += model_.one_minus_a * std::pow(model_.a, j) * light;
        if (dose >= 1) gels = j + 1;
      }
    }
    if (all <= 1) return 0;
    return gels > 0 ? gels : most;
  }

  const CureModel& model_;
  const LightBlur& blur_;
  const std::vector<DistanceBlur>& distances_;
  PixelBox box_;
};

/// Whether light spreads at least as wide as a Gaussian with a sigma of half a pixel along both axes.
/// `weights` as `LightBlur::of_weights`.
bool is_wide(const std::vector<double>& weights, int reach_x, int reach_y) {
  double sum = 0, x2 = 0, y2 = 0;
  std::size_t at = 0;
  for (int y = -reach_y; y <= reach_y; ++y) {
    for (int x = -reach_x; x <= reach_x; ++x) {
      const double w = weights[at++];
      sum += w;
      x2 += w * x * x;
      y2 += w * y * y;
    }
  }
  double least = 0, k = 0;
  for (const double tap : gaussian_taps(0.5, 1.0)) {
    least += 2 * tap * k * k;
    k += 1;
  }
  least *= 1 - 1e-9;
  return x2 >= least * sum && y2 >= least * sum;
}

int padded(int n) { return (n + kTapLanes - 1) / kTapLanes * kTapLanes; }

}  // namespace

bool can_couple(const CureModel& model) { return !model.inhibited() || can_couple_under_uv(model); }

int slices_to_gel_at_edges(const CureModel& model, const LightBlur& blur,
                           const std::vector<DistanceBlur>& distances) {
  const int least = model.slices_to_gel();
  if (blur.none() && distances.empty()) return least;
  const int most = std::max(
      least, static_cast<int>(std::ceil(1 / model.eta_of(std::numeric_limits<int>::max()))));
  const LitPart part(model, blur, distances);
  int corners = 0, edges = 0;
  for (const int sx : {-1, 1}) {
    for (const int sy : {-1, 1}) {
      corners = std::max(corners, part.slices_to_gel(most, [&](int x, int y) {
        return sx * x >= 0 && sy * y >= 0;
      }));
    }
    edges = std::max(edges, part.slices_to_gel(most, [&](int x, int) { return sx * x >= 0; }));
    edges = std::max(edges, part.slices_to_gel(most, [&](int, int y) { return sx * y >= 0; }));
  }
  return std::max({least, corners, edges});
}

void CoupledPlan::want(const DoseTarget& its_doses) {
  graded = true;
  if (!wants) return;
  doses = &its_doses;
  wants = std::make_shared<const CoupledColumns>(columns, most_dose(), uv.most);
}

void CoupledPlan::scatter_by(const std::vector<DistanceBlur>& its_distances) {
  distances = &its_distances;
  // The sums end where the bath does.
  bath = 0;
  beyond = 0;
  for (const DistanceBlur& d : its_distances) {
    halo_x = std::max(halo_x, d.blur.reach_x() - reach_x);
    halo_y = std::max(halo_y, d.blur.reach_y() - reach_y);
  }
  overlap_x = std::max(overlap_x, reach_x + halo_x / 2);
  overlap_y = std::max(overlap_y, reach_y + halo_y / 2);
}

void CoupledPlan::differ(UnevenUv its_uv) {
  uv = std::move(its_uv);
  wants = std::make_shared<const CoupledColumns>(columns, most_dose(), uv.most);
}

CoupledPlan::CoupledPlan(const CorrectionPlan& column_plan, const LightBlur& light_blur,
                         const PixelBox& display_box, double dose_margin, LightShares light_shares)
    : columns(column_plan),
      blur(light_blur),
      display(display_box),
      shares(std::move(light_shares)),
      slices(column_plan.all_layers),
      layers(column_plan.layers),
      layerwise(column_plan.model.mode == ExposureMode::layerwise),
      a(column_plan.model.a),
      b(column_plan.model.one_minus_a),
      m(column_plan.model.m),
      below(layerwise ? 0 : column_plan.model.root_a),
      norm(layerwise ? column_plan.model.root_a : 1 + column_plan.model.root_a),
      slowest(column_plan.model.a),
      bath(column_plan.model.bath_slices),
      beyond(column_plan.model.beyond),
      unit(layerwise ? a / b : 1),
      joint(columns.model.lifts ? columns.model.lifts->green_strength : 0),
      reach_x(light_blur.reach_x()),
      reach_y(light_blur.reach_y()) {
  if (!can_couple(columns.model)) {
    throw InputError(
        "light that spreads is corrected without patterned UV light: leave it out, or correct columns "
        "alone");
  }
  for (const double own : columns.model.own_a) slowest = std::max(slowest, own);
  if (want_their_light(columns.model)) wants = std::make_shared<const CoupledColumns>(columns);
  top = columns.levels.size() - 1;
  shine_step = 0;
  double light_step = 0;
  for (int l = 0; l < 256; ++l) {
    const auto k = static_cast<std::size_t>(l);
    light_of[k] = unit * columns.levels.phi(std::min(l, top));
    shine_of[k] = m == 1 ? light_of[k] : std::pow(light_of[k], 1 / m);
    if (l == 0) continue;
    shine_step = std::max(shine_step, shine_of[k] - shine_of[k - 1]);
    light_step = std::max(light_step, light_of[k] - light_of[k - 1]);
  }
  // Some level steps of a single pixel: rounding to levels spends a part of it.
  margin = dose_margin > 0 ? dose_margin : std::clamp(1.5 * b * light_step, 1e-4, 0.02);

  taps_rows = 2 * reach_y + 1;
  taps_width = padded(2 * reach_x + 1);
  std::vector<double> weights(static_cast<std::size_t>((2 * reach_x + 1) * taps_rows));
  const double one = 1;
  blur.apply(&one, {0, 0, 1, 1}, weights.data(), {-reach_x, -reach_y, reach_x + 1, reach_y + 1});
  const auto weight = [&](int x, int y) {
    return weights[static_cast<std::size_t>((y + reach_y) * (2 * reach_x + 1) + x + reach_x)];
  };
  taps.assign(static_cast<std::size_t>(taps_rows * taps_width), 0);
  for (int y = -reach_y; y <= reach_y; ++y) {
    for (int x = -reach_x; x <= reach_x; ++x) {
      taps[static_cast<std::size_t>((y + reach_y) * taps_width + x + reach_x)] = weight(x, y);
    }
  }
  taps_single.assign(taps.begin(), taps.end());

  hands_on = !wants && columns.levels.size() <= kFewLevels && is_wide(weights, reach_x, reach_y);
  const double most = *std::max_element(weights.begin(), weights.end());
  near_x = std::min(1, reach_x);
  near_y = std::min(1, reach_y);
  try_x = near_x;
  try_y = near_y;
  for (int y = -reach_y; y <= reach_y; ++y) {
    for (int x = -reach_x; x <= reach_x; ++x) {
      if (weight(x, y) < kNearShare * most) continue;
      near_x = std::clamp(std::abs(x), near_x, kMostNear);
      near_y = std::clamp(std::abs(y), near_y, kMostNear);
      if (weight(x, y) < kTryShare * most) continue;
      try_x = std::clamp(std::abs(x), try_x, kMostNear);
      try_y = std::clamp(std::abs(y), try_y, kMostNear);
    }
  }
  near_rows = 2 * near_y + 1;
  near_width = padded(2 * near_x + 1);
  near_taps.assign(static_cast<std::size_t>(near_rows * near_width), 0);
  for (int y = -near_y; y <= near_y; ++y) {
    for (int x = -near_x; x <= near_x; ++x) {
      near_taps[static_cast<std::size_t>((y + near_y) * near_width + x + near_x)] =
          static_cast<float>(weight(x, y));
    }
  }
  overlap_x = reach_x + 2 * near_x;
  overlap_y = reach_y + 2 * near_y;
  fading = 1 - std::min(0.5, b);
  depth = std::clamp(static_cast<int>(std::ceil(std::log(0.05) / std::log(fading))), 1, 80);
}

}  // namespace slicecorr::detail
