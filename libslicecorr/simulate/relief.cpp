// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/relief.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "slicecorr/error.hpp"

namespace slicecorr {

namespace {

/// Lights over a, the rate that gels in the time: they depend on heights alone.
struct Ratio {
  double blue = 0, uv = 0;  ///< uv: beta Iuv/a
};

class Shape {
 public:
  explicit Shape(const Kinetics& k) : k_(k), inhibited_(k.beta > 0 && k.huv_um > 0) {}

  double blue_at(double z) const { return std::exp(-z / k_.hb_um); }
  double uv_at(double z) const { return inhibited_ ? std::exp(-z / k_.huv_um) : 0; }

  /// The least back that `uv`, a ratio, allows: where the sum of both lights is just greatest there.
  double least_back_um(double uv) const {
    // (1 + uv E)/hb = uv E/huv  ->  E = 1/(uv (hb/huv - 1)).
    if (!(uv > 0)) return 0;
    const double share = 1 / (uv * (k_.hb_um / k_.huv_um - 1));
    return share >= 1 ? 0 : -k_.huv_um * std::log(share);
  }
  double blue_for(double back_um, double uv) const {
    return (1 + uv * uv_at(back_um)) / blue_at(back_um);
  }
  /// Where the rate comes up to a for the first time, below the back.
  double front_um(const Ratio& r, double back_um) const {
    const auto rate = [&](double z) { return r.blue * blue_at(z) - r.uv * uv_at(z); };
    if (rate(0) >= 1) return 0;
    // Between the window and the greatest rate it only rises.
    double low = 0, high = std::min(back_um, peak_um(r));
    for (int i = 0; i < 200 && high - low > 1e-12 * back_um; ++i) {
      const double middle = 0.5 * (low + high);
      (rate(middle) >= 1 ? high : low) = middle;
    }
    return high;
  }
  double peak_um(const Ratio& r) const {
    if (!(r.uv > 0)) return 0;
    const double ratio = r.uv * k_.hb_um / (r.blue * k_.huv_um);
    return ratio <= 1 ? 0 : std::log(ratio) / (1 / k_.huv_um - 1 / k_.hb_um);
  }
  /// Both lights of a front and a back.
  Ratio both(const ReliefHeights& w) const {
    const double bf = blue_at(w.front_um), bb = blue_at(w.back_um);
    const double uf = uv_at(w.front_um), ub = uv_at(w.back_um);
    const double det = bb * uf - bf * ub;
    return {(uf - ub) / det, (bf - bb) / det};
  }

 private:
  const Kinetics& k_;
  bool inhibited_;
};

void check(const Kinetics& k, const std::vector<ReliefHeights>& wanted, const ReliefGoal& goal) {
  const auto refuse = [](const std::string& what) { throw InputError("relief", "", what); };
  if (!k.adds_up()) {
    refuse("is not counted for a resin that bleaches or has a time to gel; expected another resin");
  }
  if (!(goal.most_blue_mw_cm2 > 0)) refuse("expected curing light above 0");
  if (goal.time_s && !(*goal.time_s > 0)) refuse("expected a time above 0");
  if (!goal.weight.empty() && goal.weight.size() != wanted.size()) {
    refuse(fmt::format("{} weights are given for {} wishes; expected as many", goal.weight.size(),
                       wanted.size()));
  }
  bool fronts = false, any = false;
  for (const ReliefHeights& w : wanted) {
    if (!(w.back_um >= 0) || !(w.front_um >= 0) || !std::isfinite(w.back_um)) {
      refuse("expected heights of 0 um and more");
    }
    if (w.back_um == 0) continue;
    any = true;
    fronts = fronts || w.front_um > 0;
    if (w.front_um >= w.back_um) {
      refuse(
          fmt::format("a front of {:g} um is wanted under a back of {:g} um; expected it below it",
                      w.front_um, w.back_um));
    }
  }
  if (!any) refuse("nothing is to gel; expected a back above 0 somewhere");
  if (fronts && !(k.beta > 0)) {
    refuse("fronts above the window need UV light; expected a resin with [inhibition]");
  }
  if (fronts && !(goal.most_uv_mw_cm2 > 0)) {
    refuse("fronts above the window need UV light; expected a printer with [uv]");
  }
}

/// The mean square by which fronts are off with a flood of this ratio, each back where it is wanted or at
/// the least that can be.
double misses(const Shape& shape, const std::vector<ReliefHeights>& wanted,
              const std::vector<double>& weight, double uv) {
  const double least = shape.least_back_um(uv);
  double sum = 0;
  for (std::size_t i = 0; i < wanted.size(); ++i) {
    const ReliefHeights& w = wanted[i];
    if (w.back_um == 0) continue;
    const double back = std::max(w.back_um, least);
    const Ratio r{shape.blue_for(back, uv), uv};
    const double front = shape.front_um(r, back) - w.front_um;
    const double square = front * front + (back - w.back_um) * (back - w.back_um);
    sum += weight.empty() ? square : weight[i] * square;
  }
  return sum;
}

double flood_ratio(const Shape& shape, const std::vector<ReliefHeights>& wanted,
                   const std::vector<double>& weight) {
  // Over five decades coarsely, then by golden section: fronts rise with UV light.
  double best = 0, least = misses(shape, wanted, weight, 0);
  constexpr int kSteps = 200;
  const auto ratio_of = [](double step) { return std::pow(10.0, -2 + 5 * step / kSteps); };
  double at = -1;
  for (int i = 0; i <= kSteps; ++i) {
    const double now = misses(shape, wanted, weight, ratio_of(i));
    if (now < least) {
      least = now;
      best = ratio_of(i);
      at = i;
    }
  }
  if (at < 0) return best;
  double low = std::max(0.0, at - 1), high = std::min<double>(kSteps, at + 1);
  const double golden = 0.5 * (std::sqrt(5.0) - 1);
  for (int i = 0; i < 80; ++i) {
    const double a = high - golden * (high - low), b = low + golden * (high - low);
    if (misses(shape, wanted, weight, ratio_of(a)) < misses(shape, wanted, weight, ratio_of(b))) {
      high = b;
    } else {
      low = a;
    }
  }
  return ratio_of(0.5 * (low + high));
}

}  // namespace

ReliefHeights gelled_after(const Kinetics& kinetics, double blue_mw_cm2, double uv_mw_cm2,
                           double time_s) {
  const double a = std::pow(kinetics.critical_dose_prime / time_s, 1 / kinetics.m);
  const Shape shape(kinetics);
  const Ratio r{blue_mw_cm2 / a, kinetics.beta * uv_mw_cm2 / a};
  const auto rate = [&](double z) { return r.blue * shape.blue_at(z) - r.uv * shape.uv_at(z); };
  const double peak = shape.peak_um(r);
  if (!(rate(peak) >= 1)) return {};
  double low = peak, high = peak + kinetics.hb_um;
  while (rate(high) >= 1) high += kinetics.hb_um;
  for (int i = 0; i < 200 && high - low > 1e-12 * high; ++i) {
    const double middle = 0.5 * (low + high);
    (rate(middle) >= 1 ? low : high) = middle;
  }
  return {shape.front_um(r, low), low};
}

ReliefAnswer find_relief(const Kinetics& kinetics, const std::vector<ReliefHeights>& wanted,
                         const ReliefGoal& goal) {
  check(kinetics, wanted, goal);
  const Shape shape(kinetics);
  const bool fronts = std::any_of(wanted.begin(), wanted.end(),
                                  [](const ReliefHeights& w) { return w.front_um > 0; });
  const double flood = fronts && !goal.uv_by_place ? flood_ratio(shape, wanted, goal.weight) : 0;
  ReliefAnswer relief;
  relief.least_back_um = shape.least_back_um(flood);
  std::vector<Ratio> ratios;
  double blue = 0, uv = flood;
  for (const ReliefHeights& w : wanted) {
    ReliefLight light;
    Ratio r;
    if (w.back_um > 0 && goal.uv_by_place && w.front_um > 0) {
      r = shape.both(w);
    } else if (w.back_um > 0) {
      const double back = std::max(w.back_um, relief.least_back_um);
      if (back > w.back_um) light.miss = ReliefMiss::too_low;
      r = {shape.blue_for(back, flood), flood};
    } else {
      r.uv = flood;
    }
    blue = std::max(blue, r.blue);
    uv = std::max(uv, r.uv);
    ratios.push_back(r);
    relief.places.push_back(light);
  }
  // The greatest a that both lamps allow, unless a time is asked for.
  const double beta = fronts ? kinetics.beta : 1;
  double most = goal.most_blue_mw_cm2 / blue;
  if (uv > 0) most = std::min(most, beta * goal.most_uv_mw_cm2 / uv);
  const double a =
      goal.time_s ? std::pow(kinetics.critical_dose_prime / *goal.time_s, 1 / kinetics.m) : most;
  relief.time_s =
      goal.time_s ? *goal.time_s : kinetics.critical_dose_prime / std::pow(a, kinetics.m);
  for (std::size_t i = 0; i < ratios.size(); ++i) {
    ReliefLight& light = relief.places[i];
    light.blue_mw_cm2 = a * ratios[i].blue;
    light.uv_mw_cm2 = a * ratios[i].uv / beta;
    const double least = 1 - 1e-12;
    if (light.blue_mw_cm2 * least > goal.most_blue_mw_cm2 ||
        light.uv_mw_cm2 * least > std::max(goal.most_uv_mw_cm2, 0.0)) {
      if (wanted[i].back_um > 0) light.miss = ReliefMiss::dim;
    }
    light.blue_mw_cm2 = std::min(light.blue_mw_cm2, goal.most_blue_mw_cm2);
    light.uv_mw_cm2 = std::min(light.uv_mw_cm2, goal.most_uv_mw_cm2);
    relief.uv_mw_cm2 = std::max(relief.uv_mw_cm2, light.uv_mw_cm2);
    if (wanted[i].back_um > 0) {
      light.comes = gelled_after(kinetics, light.blue_mw_cm2, light.uv_mw_cm2, relief.time_s);
    }
  }
  return relief;
}

}  // namespace slicecorr
