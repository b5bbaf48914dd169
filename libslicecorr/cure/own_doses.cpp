// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "cure/own_doses.hpp"

#include <algorithm>
#include <cmath>

#include "cure/margin.hpp"
#include "slicecorr/cure.hpp"

namespace slicecorr::detail {

OwnDoses::OwnDoses(const InhibitedKernel& kernel, double skin)
    : kernel_(kernel),
      film_(static_cast<std::size_t>(std::ceil(skin * static_cast<double>(kSamples) - kMargin))),
      known_(static_cast<std::size_t>(kernel.settings())) {
  for (auto& levels : known_) levels.resize(static_cast<std::size_t>(kernel.levels()));
}

const OwnDoses::Samples& OwnDoses::samples(int setting, int level) {
  Known& known = known_[static_cast<std::size_t>(setting)][static_cast<std::size_t>(level)];
  if (!known.is) {
    known.is = true;
    for (std::size_t k = 0; k < kSamples; ++k) {
      known.doses[k] = kernel_.exact(setting, level, static_cast<double>(k + 1) / kSamples);
    }
  }
  return known.doses;
}

OwnDoses::Own OwnDoses::of(std::span<const ImageShowing> showings, std::size_t column,
                           double ratio) {
  Samples sum{};
  for (const ImageShowing& showing : showings) {
    double light = showing.light * ratio;
    int setting = showing.setting, level = 0;
    if (showing.fronts) {
      // Kernels by front have one setting.
      setting = 0;
      level = showing.fronts[column].front;
      light *= static_cast<double>(showing.fronts[column].amount);
    } else {
      level = level_of_pixel(showing.pixels[column], kernel_.levels());
    }
    if (light == 0) continue;
    const Samples& of_level = samples(setting, level);
    for (std::size_t k = 0; k < kSamples; ++k) sum[k] += light * of_level[k];
  }
  return own_of(sum);
}

OwnDoses::Own OwnDoses::of_level(int setting, int level, double ratio) {
  Samples doses = samples(setting, level);
  for (double& dose : doses) dose *= ratio;
  return own_of(doses);
}

OwnDoses::Own OwnDoses::own_of(const Samples& doses) const {
  const auto gelled = static_cast<std::size_t>(
      std::count_if(doses.begin(), doses.end(), [](double dose) { return dose >= 1.0 - kMargin; }));
  return {*std::max_element(doses.begin(), doses.end()), doses.back(),
          gelled >= film_ && gelled > 0};
}

}  // namespace slicecorr::detail
