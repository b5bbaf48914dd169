#include "correct/coupled_plan.hpp"

#include <algorithm>
#include <cmath>

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
/// What of a dose beyond a halo may matter where doses are judged, and where light is chosen.
constexpr double kJudgedShare = 1e-9, kChosenShare = 1e-2;

int padded(int n) { return (n + kTapLanes - 1) / kTapLanes * kTapLanes; }

}  // namespace

CoupledPlan::CoupledPlan(const CorrectionPlan& column_plan, const LightBlur& light_blur,
                         const SliceScatter& slice_scatter, const PixelBox& display_box,
                         double dose_margin)
    : columns(column_plan),
      blur(light_blur),
      scatter(slice_scatter),
      display(display_box),
      slices(column_plan.all_layers),
      layers(column_plan.layers),
      a(column_plan.model.a),
      b(column_plan.model.one_minus_a),
      root_a(column_plan.model.root_a),
      m(column_plan.model.m),
      reach_x(light_blur.reach_x()),
      reach_y(light_blur.reach_y()) {
  if (!columns.model.is_plain()) {
    throw InputError(
        "light that spreads is corrected in continuous exposure without UV light, in a bath "
        "without a depth: leave these out, or correct columns alone");
  }
  top = columns.levels.size() - 1;
  shine_step = 0;
  double phi_step = 0;
  for (int l = 0; l < 256; ++l) {
    const auto k = static_cast<std::size_t>(l);
    phi_of[k] = columns.levels.phi(std::min(l, top));
    shine_of[k] = m == 1 ? phi_of[k] : std::pow(phi_of[k], 1 / m);
    if (l == 0) continue;
    shine_step = std::max(shine_step, shine_of[k] - shine_of[k - 1]);
    phi_step = std::max(phi_step, phi_of[k] - phi_of[k - 1]);
  }
  // Some level steps of a single pixel: rounding to levels spends a part of it.
  margin = dose_margin > 0 ? dose_margin : std::clamp(1.5 * b * phi_step, 1e-4, 0.02);

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
  halo_x = scatter.halo_x(a, kJudgedShare);
  halo_y = scatter.halo_y(a, kJudgedShare);
  overlap_x = std::max(reach_x + 2 * near_x, scatter.halo_x(a, kChosenShare));
  overlap_y = std::max(reach_y + 2 * near_y, scatter.halo_y(a, kChosenShare));
  fading = 1 - std::min(0.5, b);
  depth = std::clamp(static_cast<int>(std::ceil(std::log(0.05) / std::log(fading))), 1, 80);
}

}  // namespace slicecorr::detail
