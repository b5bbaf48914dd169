// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/kinetics.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "slicecorr/error.hpp"
#include "slicecorr/supports.hpp"
#include "slicecorr/units.hpp"
#include "support/numbers/bracket.hpp"

namespace slicecorr {

namespace {

/// Net intensity at z, mW/cm², >= 0; its m-th power is the rate.
double net_intensity(const Kinetics& k, double blue, double uv, double z_um) {
  return blue * std::exp(-z_um / k.hb_um) -
         (k.beta > 0 ? k.beta * uv * std::exp(-z_um / k.huv_um) : 0.0);
}

/// z in [low, high] at which the net intensity is `level`; over the interval it only rises
/// (`rises`) or only falls. Where rounding hides the crossing, right at the first gel, the end
/// nearest to it.
double crossing(const Kinetics& k, double blue, double uv, double level, bool rises, double low,
                double high) {
  // To the last bit: some 60 steps, and nothing to go wrong.
  return halved({low, high}, 200,
                [&](double z_um) { return (net_intensity(k, blue, uv, z_um) < level) == rises; })
      .middle();
}

bool is_inhibited(const Kinetics& k, double uv) { return k.beta > 0 && uv > 0; }

double slope(const Kinetics& k) { return 1.0 / k.huv_um - 1.0 / k.hb_um; }

/// sum over n of (q)_n x^n / (n! (p + n)), 0 <= x <= 0.9: x^-p times the incomplete beta function
/// of x with p and 1 - q.
double beta_series(double x, double p, double q) {
  double sum = 1 / p, factor = 1;
  for (int n = 1; n < 2000; ++n) {
    factor *= (q + n - 1) / n * x;
    const double term = factor / (p + n);
    sum += term;
    if (std::abs(term) <= 1e-17 * std::abs(sum)) break;
  }
  return sum;
}

/// The integral over all z of (e^(-z/hb) - ratio e^(-z/huv))^m where that is positive, um. With
/// u = ratio e^(-k z), k = 1/huv - 1/hb and p = m / (hb k) it is ratio^-p / k times the incomplete
/// beta function of min(1, ratio) with p and m + 1.
double inhibited_integral_um(const Kinetics& k, double ratio) {
  const double p = k.m / (k.hb_um * slope(k));
  if (ratio <= 0.9) return beta_series(ratio, p, -k.m) / slope(k);
  // A ratio near 1 or above: the whole function less the rest, whose series converges fast there.
  double beta = std::beta(p, k.m + 1);
  if (ratio < 1) {
    beta -= std::pow(1 - ratio, k.m + 1) * beta_series(1 - ratio, k.m + 1, 1 - p);
  }
  return beta * std::pow(ratio, -p) / slope(k);
}

}  // namespace

Kinetics make_kinetics(const Resin& resin, bool inhibited, bool aim) {
  if (inhibited) refuse_law(resin, LawUse::uv_exposure);
  Kinetics k;
  k.hb_um = units::height_e_from_10(resin.absorbance_height10_um);
  k.m = resin.m;
  const double factor = resin.dose_factor > 0 ? resin.dose_factor : 1.0;
  if (resin.has_gel_time()) {
    const double times = aim ? 1.0 : 1.0 / factor;
    k.gel_time = {resin.gel_a_mj_cm2 * times, resin.gel_b_sqrt_mw_cm2_s * times};
    k.critical_dose_prime = 1.0;
    if (!(k.hb_um > 0)) {
      throw InputError(resin.name, "cure", "the resin has no absorbance height; expected one");
    }
    return k;
  }
  if (resin.critical_dose_prime > 0) {
    k.critical_dose_prime = resin.critical_dose_prime / (aim ? 1.0 : factor);
  } else if (!aim && resin.gel_dose_mj_cm3 > 0) {
    k.critical_dose_prime =
        units::areal_from_volumetric(resin.gel_dose_mj_cm3, dose_height_e_um(resin));
  } else {
    k.critical_dose_prime =
        units::areal_from_volumetric(resin.critical_dose_mj_cm3, dose_height_e_um(resin)) /
        (aim ? 1.0 : factor);
  }
  if (resin.bleaches()) {
    k.bleaching.emplace(1.0 / k.hb_um,
                        1.0 / units::height_e_from_10(resin.bleaching->absorbance_height10_um),
                        resin.bleaching->dose_mj_cm2);
  }
  if (inhibited) {
    if (!resin.inhibition) {
      throw InputError(resin.name, "inhibition",
                       "the resin has no inhibition by UV light; expected beta and "
                       "absorbance_height_um");
    }
    k.beta = resin.inhibition->beta;
    k.huv_um = units::height_e_from_10(resin.inhibition->absorbance_height10_um);
    k.m = resin.inhibition->m;
    if (resin.inhibition->critical_dose_prime > 0) {
      k.critical_dose_prime = resin.inhibition->critical_dose_prime * (aim ? factor : 1.0);
    }
  }
  if (!(k.hb_um > 0)) {
    throw InputError(resin.name, "cure", "the resin has no absorbance height; expected one");
  }
  if (!(k.critical_dose_prime > 0)) {
    throw InputError(resin.name, "cure",
                     "the resin has no dose; expected a gel dose or a critical dose");
  }
  return k;
}

double cured_height_um(const Kinetics& k, double blue_mw_cm2, double exposure_s) {
  if (k.has_gel_time()) {
    return k.hb_um *
           (std::log(blue_mw_cm2) - std::log(gel_intensity_mw_cm2(k.gel_time, exposure_s)));
  }
  if (k.bleaching) return k.bleaching->length(blue_mw_cm2 * exposure_s, k.critical_dose_prime);
  // Sum of logarithms: the product of their arguments may overflow where the height does not.
  return k.hb_um * std::log(blue_mw_cm2) +
         k.hb_um / k.m * (std::log(exposure_s) - std::log(k.critical_dose_prime));
}

double exposure_for_height_s(const Kinetics& k, double blue_mw_cm2, double height_um) {
  if (k.has_gel_time()) {
    return gel_time_s(k.gel_time, blue_mw_cm2 * std::exp(-height_um / k.hb_um));
  }
  if (k.bleaching) {
    return k.bleaching->after(k.critical_dose_prime, -height_um, 0.0) / blue_mw_cm2;
  }
  return k.critical_dose_prime * std::exp(k.m * (height_um / k.hb_um - std::log(blue_mw_cm2)));
}

double dose_prime_at(const Kinetics& k, double blue_mw_cm2, double uv_mw_cm2, double z_um,
                     double exposure_s) {
  if (k.bleaching) return k.bleaching->after(blue_mw_cm2 * exposure_s, z_um, 0.0);
  const double net = std::max(0.0, net_intensity(k, blue_mw_cm2, uv_mw_cm2, z_um));
  if (k.has_gel_time()) return net > 0 ? exposure_s / gel_time_s(k.gel_time, net) : 0.0;
  return (k.m == 1.0 ? net : std::pow(net, k.m)) * exposure_s;
}

bool keeps_dead_zone(const Kinetics& k, double blue_mw_cm2, double uv_mw_cm2) {
  return blue_mw_cm2 <= 0 || (is_inhibited(k, uv_mw_cm2) && k.beta * uv_mw_cm2 > blue_mw_cm2);
}

double steady_dead_zone_um(const Kinetics& k, double blue_mw_cm2, double uv_mw_cm2) {
  if (blue_mw_cm2 <= 0) return std::numeric_limits<double>::infinity();
  if (!keeps_dead_zone(k, blue_mw_cm2, uv_mw_cm2)) return 0;
  return std::log(k.beta * uv_mw_cm2 / blue_mw_cm2) / slope(k);
}

FirstGel first_gel(const Kinetics& k, double blue_mw_cm2, double uv_mw_cm2) {
  FirstGel first;
  if (blue_mw_cm2 <= 0)
    return {std::numeric_limits<double>::infinity(), std::numeric_limits<double>::infinity()};
  if (k.has_gel_time()) return {0, gel_time_s(k.gel_time, blue_mw_cm2)};
  if (is_inhibited(k, uv_mw_cm2)) {
    const double ratio = k.beta * uv_mw_cm2 * k.hb_um / (blue_mw_cm2 * k.huv_um);
    first.z_um = std::max(0.0, std::log(ratio) / slope(k));
  }
  // At z0 > 0 the UV share is huv/hb of the blue one: no difference of numbers that nearly cancel.
  const double net = first.z_um > 0
                         ? blue_mw_cm2 * std::exp(-first.z_um / k.hb_um) * (1 - k.huv_um / k.hb_um)
                         : net_intensity(k, blue_mw_cm2, uv_mw_cm2, 0);
  first.time_s = net > 0 ? k.critical_dose_prime / std::pow(net, k.m)
                         : std::numeric_limits<double>::infinity();
  return first;
}

std::optional<CuringFronts> curing_fronts(const Kinetics& k, double blue_mw_cm2, double uv_mw_cm2,
                                          double exposure_s) {
  if (blue_mw_cm2 <= 0 || exposure_s <= 0) return std::nullopt;
  CuringFronts fronts;
  if (!is_inhibited(k, uv_mw_cm2)) {
    fronts.back_um = cured_height_um(k, blue_mw_cm2, exposure_s);
    return fronts.back_um >= 0 ? std::optional(fronts) : std::nullopt;
  }
  const FirstGel first = first_gel(k, blue_mw_cm2, uv_mw_cm2);
  if (!(exposure_s >= first.time_s)) return std::nullopt;
  // Gelled where the net intensity is at least the one that reaches D'c in this time.
  const double level = std::pow(k.critical_dose_prime / exposure_s, 1.0 / k.m);
  if (net_intensity(k, blue_mw_cm2, uv_mw_cm2, 0) < level) {
    fronts.front_um = crossing(k, blue_mw_cm2, uv_mw_cm2, level, true, 0, first.z_um);
  }
  // Beyond the height without UV there can be no gel with it.
  const double farthest = std::max(first.z_um, cured_height_um(k, blue_mw_cm2, exposure_s));
  fronts.back_um = crossing(k, blue_mw_cm2, uv_mw_cm2, level, false, first.z_um, farthest);
  return fronts;
}

double window_time_s(const Kinetics& k, double blue_mw_cm2, double uv_mw_cm2) {
  const double net = net_intensity(k, blue_mw_cm2, uv_mw_cm2, 0);
  if (k.has_gel_time() && net > 0) return gel_time_s(k.gel_time, net);
  return net > 0 ? k.critical_dose_prime / std::pow(net, k.m)
                 : std::numeric_limits<double>::infinity();
}

double passing_dose_prime(const Kinetics& k, double blue_mw_cm2, double uv_mw_cm2,
                          double speed_mm_h) {
  if (blue_mw_cm2 <= 0) return 0;
  if (k.has_gel_time()) return passing_dose(k.gel_time, blue_mw_cm2, k.hb_um, speed_mm_h);
  if (k.bleaching) {
    return k.bleaching->steady(blue_mw_cm2 / (units::cm_s_from_mm_h(speed_mm_h) * 1e4));
  }
  const double distance_um = is_inhibited(k, uv_mw_cm2)
                                 ? inhibited_integral_um(k, k.beta * uv_mw_cm2 / blue_mw_cm2)
                                 : k.hb_um / k.m;
  return std::pow(blue_mw_cm2, k.m) * distance_um * 1e-4 / units::cm_s_from_mm_h(speed_mm_h);
}

}  // namespace slicecorr
