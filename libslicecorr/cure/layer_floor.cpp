// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "cure/layer_floor.hpp"

#include <cmath>
#include <cstddef>

namespace slicecorr::detail {

namespace {

/// How far from its front a light is concave, um. With v = u/(1 - u), a = 1/hb and s = 1/huv - 1/hb:
/// f''/f = m^2 a^2 - m s (s + 2 m a) v - m (1 - m) s^2 v^2, which falls with v.
double concave_um(const Kinetics& k) {
  const double a = 1.0 / k.hb_um, s = 1.0 / k.huv_um - a;
  const double square = (1.0 - k.m) * s * s, line = s * (s + 2.0 * k.m * a), at_0 = k.m * a * a;
  // The place where it is 0: the root above 0 of square v^2 + line v - at_0.
  const double v = 2.0 * at_0 / (line + std::sqrt(line * line + 4.0 * square * at_0));
  return std::log1p(1.0 / v) / s;
}

/// Grey by pulses has light of two fronts at each level.
bool has_pulses(const InhibitedKernel& kernel) {
  for (int l = 1; l < kernel.levels(); ++l) {
    if (kernel.brightest_of(l) != kernel.level_mw_cm2(l)) return true;
  }
  return false;
}

/// The least value of a parabola that bends by `bend` (its second derivative, 0 or more) between two places `apart`.
double least_of_parabola(double from, double to, double apart, double bend) {
  const double sag = bend * apart * apart, rise = std::abs(to - from);
  if (2.0 * rise >= sag) return std::min(from, to);
  return 0.5 * (from + to) - sag / 8.0 - rise * rise / (2.0 * sag);
}

}  // namespace

LayerFloor::LayerFloor(const InhibitedKernel& kernel)
    : kernel_(kernel), per_um_(1.0 / kernel.layer_um()) {
  const Kinetics& k = kernel.kinetics();
  exists_ = kernel.layer_by_layer() && kernel.alike() && !kernel.ends() && k.m <= 1.0 &&
            !has_pulses(kernel) && concave_um(k) >= kernel.layer_um();
  const double c = k.m * kernel.layer_um() / k.hb_um;
  bend_ = c * c;
  rise_in_half_ = std::exp(0.5 * c);
}

void LayerFloor::take_front(double x, int setting, int level, double weight) {
  const int j = static_cast<int>(x);
  const auto at = static_cast<std::size_t>(j * kernel_.levels() + level);
  const auto dose = [&](InhibitedKernel::LayerPosition place) {
    return weight * kernel_.table(setting, place)[at];
  };
  const Front front{x - j, dose(InhibitedKernel::middle), dose(InhibitedKernel::upper_end)};
  const auto after =
      std::find_if(fronts_.begin(), fronts_.end(), [&](const Front& f) { return f.t > front.t; });
  fronts_.insert(after, front);
}

double LayerFloor::least(const Doses& doses) const {
  return std::min(least_of_half(doses.lower, doses.middle, false),
                  least_of_half(doses.middle, doses.upper, true));
}

/// The least dose of one half of the layer, from those at its ends.
double LayerFloor::least_of_half(double from, double to, bool upper_half) const {
  const double begin = upper_half ? 0.5 : 0.0, end = begin + 0.5;
  const auto at_begin = [&](const Front& f) { return upper_half ? f.middle : 0.0; };
  const auto at_end = [&](const Front& f) { return upper_half ? f.upper : f.middle; };
  double from_rest = from, to_rest = to;
  for (const Front& f : fronts_) {
    from_rest -= at_begin(f);
    to_rest -= at_end(f);
  }
  const double bend = bend_ * std::max({from_rest, to_rest, 0.0});
  double least = std::min(from, to), before = from, place = begin;
  for (const Front& front : fronts_) {
    if (front.t <= begin || front.t >= end) continue;
    const double t = front.t, share = 2.0 * (t - begin);
    double dose = from_rest + share * (to_rest - from_rest) - 0.5 * bend * (t - begin) * (end - t);
    for (const Front& f : fronts_) {
      if (f.t >= t) break;
      const double since = std::max(begin, f.t), low = at_begin(f);
      dose += low + (at_end(f) - low) * (t - since) / (end - since);
    }
    least = std::min(least, least_of_parabola(before, dose, t - place, bend));
    before = dose;
    place = t;
  }
  return std::min(least, least_of_parabola(before, to, end - place, bend));
}

}  // namespace slicecorr::detail
