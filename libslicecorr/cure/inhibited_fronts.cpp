// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Kernels of light that spreads: by the front of blue and UV light, in place of grey levels.

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>

#include "cure/front_profile.hpp"
#include "slicecorr/dose.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/inhibited.hpp"

namespace slicecorr {

InhibitedKernel::InhibitedKernel(const InhibitedKernel& of, double first_um, double last_um)
    : kinetics_(of.kinetics_),
      gel_(of.gel_),
      mode_(of.mode_),
      allow_window_cure_(of.allow_window_cure_),
      layer_um_(of.layer_um_),
      scale_(of.scale_),
      gel_scale_(of.gel_scale_),
      a_(of.a_),
      near_(of.near_),
      blue_(kFronts, 0.0),
      setting_uv_(1, 0.0),
      profile_(of.profile_),
      depth_um_(of.depth_um_) {
  const double step_um = (last_um - first_um) / (kFronts - 1);
  fronts_per_um_ = 1 / step_um;
  for (int front = 0; front < kFronts; ++front) {
    sources_.push_back({scale_, first_um + front * step_um});
  }
  make_tables();
}

std::shared_ptr<const InhibitedKernel> InhibitedKernel::by_front(double least_blue_mw_cm2) const {
  if (!alike()) {
    throw InputError(fmt::format(
        "light spreads under UV light {}, where each slice has tables of its own, and each of the {} fronts of light "
        "that spreads a row in each: more than there is room for; expected light that stays in its pixel, {}, or no UV "
        "light",
        reflectance_ > 0 ? "below a platform that sends light back"
                         : "in layers of different heights",
        kFronts, reflectance_ > 0 ? "a platform that takes it up" : "layers of one height"));
  }
  if (gap_um_ > 0) {
    throw InputError(
        "light spreads and is made for an even dead zone; expected one of both: the dose of resin "
        "that flows is known for the light of grey levels");
  }
  double most_uv = 0, least_uv = std::numeric_limits<double>::infinity();
  for (int s = 0; s < settings(); ++s) {
    for (int level = 0; level < levels(); ++level) {
      most_uv = std::max(most_uv, uv_of(s, level));
      least_uv = std::min(least_uv, uv_of(s, level));
    }
  }
  // Behind the window by so much, UV light takes no share of what any point gets.
  const double behind = std::log(kTailShare) / (1.0 / kinetics_.huv_um - 1.0 / kinetics_.hb_um);
  // At the edges of a pattern that spreads there is less UV light than any level gives.
  const double first =
      uv_levels_.empty()
          ? std::max(behind, profile_->front_um(blue_.back(), kinetics_.beta * least_uv))
          : behind;
  const double last =
      profile_->front_um(std::min(least_blue_mw_cm2, blue_.back()), kinetics_.beta * most_uv);
  // NOLINTNEXTLINE(cppcoreguidelines-owning-memory): the constructor is private
  return std::shared_ptr<const InhibitedKernel>(
      new InhibitedKernel(*this, first, std::max(last, first + layer_um_)));
}

FrontLight InhibitedKernel::front_light(double blue_mw_cm2, double uv_mw_cm2) const {
  if (!(blue_mw_cm2 > 0)) return {};
  if (fronts_per_um_ == 0) {
    // Its own levels, of its own UV light: the nearest, times so much.
    const auto above = std::lower_bound(blue_.begin() + 1, blue_.end() - 1, blue_mw_cm2);
    const auto nearest =
        above - blue_.begin() > 1 && blue_mw_cm2 - *std::prev(above) < *above - blue_mw_cm2
            ? std::prev(above)
            : above;
    return {static_cast<float>(std::pow(blue_mw_cm2 / *nearest, kinetics_.m)),
            static_cast<std::uint16_t>(nearest - blue_.begin())};
  }
  const double first = sources_.front().front_um;
  const double exact = profile_->front_um(blue_mw_cm2, kinetics_.beta * uv_mw_cm2);
  const double step = std::clamp(std::round((exact - first) * fronts_per_um_), 0.0,
                                 static_cast<double>(levels() - 1));
  const auto front = static_cast<std::uint16_t>(step);
  // With the front as rounded, light is exact where no UV light comes.
  return {static_cast<float>(profile_->amount(blue_mw_cm2, sources_[front].front_um)), front};
}

double InhibitedKernel::blue_of(const FrontLight& light) const {
  if (fronts_per_um_ == 0) {
    return std::pow(static_cast<double>(light.amount), 1.0 / kinetics_.m) * blue_[light.front];
  }
  return std::pow(static_cast<double>(light.amount), 1.0 / kinetics_.m) *
         std::exp(sources_[light.front].front_um / kinetics_.hb_um);
}

}  // namespace slicecorr
