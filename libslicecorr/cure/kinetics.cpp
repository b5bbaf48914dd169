#include "slicecorr/kinetics.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "slicecorr/error.hpp"
#include "slicecorr/units.hpp"

namespace slicecorr {

namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();

/// Net intensity at z; m-th power of it is the rate.
double net_intensity(const Kinetics& k, double blue, double uv, double z_um) {
  return blue * std::exp(-z_um / k.hb_um) -
         (k.beta > 0 ? k.beta * uv * std::exp(-z_um / k.huv_um) : 0.0);
}

/// z in [low, high] at which the net intensity is `level`; it rises over the interval, or falls.
double crossing(const Kinetics& k, double blue, double uv, double level, double low, double high) {
  const bool rises = net_intensity(k, blue, uv, low) < level;
  // Bisection to the last bit: some 60 steps, and nothing to go wrong.
  for (int i = 0; i < 200; ++i) {
    const double middle = 0.5 * (low + high);
    if (!(middle > low && middle < high)) break;
    const bool below = net_intensity(k, blue, uv, middle) < level;
    (below == rises ? low : high) = middle;
  }
  return 0.5 * (low + high);
}

bool is_inhibited(const Kinetics& k, double uv) { return k.beta > 0 && uv > 0; }

double slope(const Kinetics& k) { return 1.0 / k.huv_um - 1.0 / k.hb_um; }

}  // namespace

Kinetics make_kinetics(const Resin& resin, bool inhibited, bool aim) {
  Kinetics k;
  k.hb_um = units::height_e_from_10(resin.absorbance_height10_um);
  k.m = resin.m;
  const double factor = resin.dose_factor > 0 ? resin.dose_factor : 1.0;
  if (resin.critical_dose_prime > 0) {
    k.critical_dose_prime = resin.critical_dose_prime / (aim ? 1.0 : factor);
  } else if (!aim && resin.gel_dose_mj_cm3 > 0) {
    k.critical_dose_prime = units::areal_from_volumetric(resin.gel_dose_mj_cm3, k.hb_um);
  } else {
    k.critical_dose_prime =
        units::areal_from_volumetric(resin.critical_dose_mj_cm3, k.hb_um) / (aim ? 1.0 : factor);
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
  return k;
}

double cured_height_um(const Kinetics& k, double blue_mw_cm2, double exposure_s) {
  // Logarithms apart: the product may overflow where the height does not.
  return k.hb_um * std::log(blue_mw_cm2) +
         k.hb_um / k.m * (std::log(exposure_s) - std::log(k.critical_dose_prime));
}

double exposure_for_height_s(const Kinetics& k, double blue_mw_cm2, double height_um) {
  return k.critical_dose_prime * std::exp(k.m * (height_um / k.hb_um - std::log(blue_mw_cm2)));
}

double dose_prime_at(const Kinetics& k, double blue_mw_cm2, double uv_mw_cm2, double z_um,
                     double exposure_s) {
  const double net = std::max(0.0, net_intensity(k, blue_mw_cm2, uv_mw_cm2, z_um));
  return (k.m == 1.0 ? net : std::pow(net, k.m)) * exposure_s;
}

double steady_dead_zone_um(const Kinetics& k, double blue_mw_cm2, double uv_mw_cm2) {
  if (blue_mw_cm2 <= 0) return infinity;
  if (!is_inhibited(k, uv_mw_cm2)) return 0;
  return std::max(0.0, std::log(k.beta * uv_mw_cm2 / blue_mw_cm2) / slope(k));
}

FirstGel first_gel(const Kinetics& k, double blue_mw_cm2, double uv_mw_cm2) {
  FirstGel first;
  if (blue_mw_cm2 <= 0) return {infinity, infinity};
  if (is_inhibited(k, uv_mw_cm2)) {
    const double ratio = k.beta * uv_mw_cm2 * k.hb_um / (blue_mw_cm2 * k.huv_um);
    first.z_um = std::max(0.0, std::log(ratio) / slope(k));
  }
  const double net = net_intensity(k, blue_mw_cm2, uv_mw_cm2, first.z_um);
  first.time_s = net > 0 ? k.critical_dose_prime / std::pow(net, k.m) : infinity;
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
    fronts.front_um = crossing(k, blue_mw_cm2, uv_mw_cm2, level, 0, first.z_um);
  }
  // Beyond the height without UV there can be no gel with it.
  const double farthest = std::max(first.z_um, cured_height_um(k, blue_mw_cm2, exposure_s));
  fronts.back_um = crossing(k, blue_mw_cm2, uv_mw_cm2, level, first.z_um, farthest);
  return fronts;
}

double window_time_s(const Kinetics& k, double blue_mw_cm2, double uv_mw_cm2) {
  const double net = net_intensity(k, blue_mw_cm2, uv_mw_cm2, 0);
  return net > 0 ? k.critical_dose_prime / std::pow(net, k.m) : infinity;
}

}  // namespace slicecorr
