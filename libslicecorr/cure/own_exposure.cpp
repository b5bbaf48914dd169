// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "cure/own_exposure.hpp"

#include <cmath>

#include "slicecorr/gel_time.hpp"
#include "slicecorr/units.hpp"

namespace slicecorr::detail {

OwnExposure own_exposure(const CureModel& model, int slice, double phi) {
  const double ratio = model.ratio(slice), skin = model.lifts->skin;
  if (const GelTimeKernel* const kernel = model.gel_time()) {
    const CutLight light = kernel->in_slice(slice, kernel->light_of_phi(phi), ratio);
    const auto dose = [&](double up) {
      const CutLight fade = kernel->fade(up * model.height(slice));
      const double back = model.returned(slice + 1 - up);
      // The cut is where what comes before it and what comes after it are worth the same.
      const double x = light.x * fade.x * back, y = light.y * fade.y * std::sqrt(back);
      return x + y > 0 ? x * y / (x + y) : 0.0;
    };
    return {dose(0), dose(skin), dose(1)};
  }
  if (const BleachingLaw* const law = model.bleaching()) {
    const double near = phi * ratio, height = model.height(slice);
    return {near, law->after(near, skin * height, 0.0), law->after(near, height, 0.0)};
  }
  const double near = phi * ratio;
  return {near * model.returned(slice + 1),
          near * std::exp(-skin * model.eta_of(slice) * units::kLn10) *
              model.returned(slice + 1 - skin),
          near * model.a_of(slice) * model.returned(slice)};
}

}  // namespace slicecorr::detail
