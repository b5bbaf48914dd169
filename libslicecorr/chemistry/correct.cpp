// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "chemistry/consumption.hpp"
#include "chemistry/light.hpp"
#include "slicecorr/chemistry_pattern.hpp"
#include "slicecorr/error.hpp"
#include "support/numbers/bracket.hpp"

namespace slicecorr {

namespace {

using detail::Consumption;
using detail::LightWanted;

/// The time that is taken where none is asked for, over the least one: what full light needs leaves no
/// light to choose where oxygen comes fastest.
constexpr double kTimeToSpare = 1.25;

struct Extremes {
  double least_inside = 0, most_outside = 0;
};
Extremes extremes(const std::vector<double>& u, const std::vector<char>& inside) {
  Extremes e{1e300, 0};
  for (std::size_t k = 0; k < u.size(); ++k) {
    if (inside[k]) {
      e.least_inside = std::min(e.least_inside, u[k]);
    } else {
      e.most_outside = std::max(e.most_outside, u[k]);
    }
  }
  return e;
}

/// Light for a target whose oxygen is to be used up everywhere.
std::vector<double> search(Consumption& A, const std::vector<char>& inside, double margin,
                           int steps, const ExecutionContext& context) {
  LightWanted wanted;
  for (const char in : inside) wanted.used_up.push_back(in ? 1 : -1);
  wanted.least.assign(inside.size(), 0.0);
  wanted.most.assign(inside.size(), 1.0);
  wanted.most_elsewhere = 1 - margin;
  return detail::find_light(A, wanted, {inside.begin(), inside.end()}, steps, context);
}

/// The least time in which full light on the target alone uses up its oxygen; infinite where diffusion
/// brings enough for `most_s`.
double least_time(Consumption& A, const std::vector<char>& inside, double start_s, double most_s,
                  const ExecutionContext& context) {
  const auto reached = [&](double T) {
    context.check_cancelled();
    A.set_time(T);
    std::vector<double> u(inside.begin(), inside.end());
    A.apply(u, context);
    return extremes(u, inside).least_inside;
  };
  double low = start_s, high = start_s;
  while (reached(high) < 1) {
    low = high;
    high *= 2;
    if (high > most_s) return std::numeric_limits<double>::infinity();
  }
  return halved_by_ratio({low, high}, 12, 1.003, [&](double t) { return reached(t) < 1; }).high;
}

}  // namespace

CorrectedPattern correct_pattern(const Chemistry& c, const LightPattern& target,
                                 const PatternSetup& setup, const PatternCorrection& correction,
                                 const ExecutionContext& context) {
  detail::check_pattern(c, target, setup);
  if (!(correction.margin > 0 && correction.margin < 1) || correction.steps < 1 ||
      !(correction.used_up_by_s >= 0) || !std::isfinite(correction.used_up_by_s)) {
    throw InputError(
        fmt::format("a correction with a margin of {:g}, {} steps and oxygen used up by "
                    "{:g} s; expected a margin between 0 and 1, some steps, and a time",
                    correction.margin, correction.steps, correction.used_up_by_s));
  }
  if (!(c.oxygen_mol_l > 0)) {
    throw InputError("the resin has no oxygen; expected some: it is what light is balanced by");
  }
  std::vector<char> inside;
  for (const float share : target.share) inside.push_back(share >= 0.5F ? 1 : 0);
  if (std::find(inside.begin(), inside.end(), 1) == inside.end()) {
    throw InputError("nothing of the image is lit; expected pixels of at least half of the light");
  }
  const auto consumption = [&](const PatternSetup& s) {
    return Consumption(c, target.width, target.height, s.sides, s.cell_um, s.spread_um,
                       s.intensity_mw_cm2 * mean_light_share(c, s.film_um));
  };
  Consumption A = consumption(setup);
  const double begin =
      inhibition_time_s(c, setup.intensity_mw_cm2 * mean_light_share(c, setup.film_um));
  constexpr double most_times = 4096;
  const double least = least_time(A, inside, begin, begin * most_times, context);
  if (!std::isfinite(least)) {
    throw InfeasibleError(
        fmt::format("oxygen comes from around the target faster than {:g} mW/cm² "
                    "use it up; expected more light or larger features",
                    setup.intensity_mw_cm2));
  }
  CorrectedPattern found;
  found.used_up_by_s = correction.used_up_by_s > 0 ? correction.used_up_by_s
                                                   : std::min(kTimeToSpare * least, setup.light_s);
  A.set_time(found.used_up_by_s);
  std::vector<double> u(inside.begin(), inside.end());
  A.apply(u, context);
  // What is left of it at T is used up soon after, while light is on; but much is more than a correction
  // can even out.
  if (extremes(u, inside).least_inside < 1 - 2 * correction.margin) {
    throw InfeasibleError(fmt::format(
        "{:g} mW/cm² do not use up oxygen in the whole target within {:.4g} s; they would within "
        "{:.4g} s, or {:.4g} mW/cm² would",
        setup.intensity_mw_cm2, found.used_up_by_s, least,
        setup.intensity_mw_cm2 / extremes(u, inside).least_inside));
  }
  std::vector<double> light = search(A, inside, correction.margin, correction.steps, context);
  found.light.width = target.width;
  found.light.height = target.height;
  constexpr double levels = 255;
  for (double& v : light) {
    v = std::round(v * levels) / levels;
    found.light.share.push_back(static_cast<float>(v));
  }
  A.apply(light, context);
  const Extremes e = extremes(light, inside);
  found.least_inside = e.least_inside;
  found.most_outside = e.most_outside;
  if (e.most_outside < std::min(1.0, e.least_inside)) return found;
  // Brighter light for a shorter time leaves oxygen less time to come from the sides.
  for (double brighter = 2; brighter <= 64; brighter *= 2) {
    PatternSetup more = setup;
    more.intensity_mw_cm2 *= brighter;
    Consumption B = consumption(more);
    const double T =
        kTimeToSpare * least_time(B, inside, begin / brighter, begin * most_times, context);
    if (!std::isfinite(T)) continue;
    B.set_time(T);
    std::vector<double> tried = search(B, inside, correction.margin, 100, context);
    B.apply(tried, context);
    const Extremes t = extremes(tried, inside);
    if (t.most_outside >= std::min(1.0, t.least_inside)) continue;
    throw InfeasibleError(fmt::format(
        "with {:g} mW/cm² and oxygen used up by {:.4g} s something outside of the target gels as "
        "well; {:g} mW/cm² for {:.4g} s would do",
        setup.intensity_mw_cm2, found.used_up_by_s, more.intensity_mw_cm2, T));
  }
  throw InfeasibleError(fmt::format(
      "something outside of the target gels as well, and brighter light does not help: what is meant "
      "to stay open is too narrow for a spread of {:g} um",
      setup.spread_um));
}

}  // namespace slicecorr
