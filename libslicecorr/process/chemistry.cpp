// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/chemistry.hpp"

#include <cmath>
#include <limits>
#include <numbers>

#include "slicecorr/units.hpp"
#include "support/numbers/bracket.hpp"

namespace slicecorr {

namespace {

// Exact by definition of the SI.
constexpr double kAvogadro = 6.02214076e23, kPlanck = 6.62607015e-34, kLight = 299792458.0,
                 kBoltzmann = 1.380649e-23;
constexpr double kNever = std::numeric_limits<double>::infinity();

/// 1/cm, base e.
double absorption(const Chemistry& c) {
  return c.absorptivity_l_mol_cm * c.initiator_mol_l + c.other_absorption_per_cm;
}

/// arcosh(exp(y)) for y >= 0 without loss near 0, and where exp(y) is too large a number.
double arcosh_of_exp(double y) { return y + std::log1p(std::sqrt(-std::expm1(-2 * y))); }

double shape_factor(FeatureShape shape, double half_width_um, double d_um2_s, double seconds) {
  if (!(seconds > 0) || !(d_um2_s > 0)) return 1;
  const double x = half_width_um / std::sqrt(4 * d_um2_s * seconds);
  if (shape == FeatureShape::disc) return -std::expm1(-x * x);
  const double line = std::erf(x);
  return shape == FeatureShape::line ? line : line * line;
}

/// Time's integral of the factor from 0 to t, by Gauss-Legendre in ln t: the factor is 1 up to
/// about a²/64D and has no scale shorter than its age after it.
double factor_integral_s(FeatureShape shape, double half_width_um, double d_um2_s, double t) {
  const double start = half_width_um * half_width_um / (256 * d_um2_s);
  if (!(d_um2_s > 0) || t <= start) return t;
  constexpr double node[] = {0.1834346424956498, 0.5255324099163290, 0.7966664774136267,
                             0.9602898564975363};
  constexpr double weight[] = {0.3626837833783620, 0.3137066458778873, 0.2223810344533745,
                               0.1012285362903763};
  const double span = std::log(t / start);
  const int pieces = 1 + static_cast<int>(span / 0.7);
  const double half = span / pieces / 2;
  double sum = start;
  for (int k = 0; k < pieces; ++k) {
    const double middle = std::log(start) + (2 * k + 1) * half;
    for (int j = 0; j < 4; ++j) {
      for (const double sign : {-1.0, 1.0}) {
        const double s = std::exp(middle + sign * node[j] * half);
        sum += weight[j] * half * s * shape_factor(shape, half_width_um, d_um2_s, s);
      }
    }
  }
  return sum;
}

}  // namespace

double photon_energy_j_mol(double wavelength_nm) {
  return kAvogadro * kPlanck * kLight / (wavelength_nm * 1e-9);
}

double stokes_einstein_um2_s(double temperature_k, double viscosity_pa_s, double radius_angstrom) {
  return 1e12 * kBoltzmann * temperature_k /
         (6 * std::numbers::pi * viscosity_pa_s * radius_angstrom * 1e-10);
}

double light_height_um(const Chemistry& c) {
  return units::height_e_from_absorption_per_cm(absorption(c));
}

double absorbed_share(const Chemistry& c, double film_um) {
  return -std::expm1(-film_um / light_height_um(c));
}

double mean_light_share(const Chemistry& c, double film_um) {
  const double depth = film_um / light_height_um(c);
  return depth > 0 ? -std::expm1(-depth) / depth : 1;
}

double initiation_per_s(const Chemistry& c, double intensity_mw_cm2) {
  // mW/cm² over J/mol is 1e-3 mol/(cm² s); l/(mol cm) is 1e3 cm²/mol.
  return c.quantum_yield * c.absorptivity_l_mol_cm * intensity_mw_cm2 /
         photon_energy_j_mol(c.wavelength_nm);
}

double radicals_mol_l_s(const Chemistry& c, double intensity_mw_cm2) {
  return 2 * initiation_per_s(c, intensity_mw_cm2) * c.initiator_mol_l;
}

double inhibition_time_s(const Chemistry& c, double intensity_mw_cm2) {
  return (c.oxygen_mol_l + c.inhibitor_mol_l) / radicals_mol_l_s(c, intensity_mw_cm2);
}

double inhibition_time_used_up_s(const Chemistry& c, double intensity_mw_cm2) {
  const double share = (c.oxygen_mol_l + c.inhibitor_mol_l) / (2 * c.initiator_mol_l);
  return share < 1 ? -std::log1p(-share) / initiation_per_s(c, intensity_mw_cm2) : kNever;
}

double threshold_intensity_mw_cm2(const Chemistry& c, double supply_per_s) {
  return supply_per_s * c.oxygen_mol_l / radicals_mol_l_s(c, 1);
}

double inhibition_time_supplied_s(const Chemistry& c, double intensity_mw_cm2,
                                  double supply_per_s) {
  const double least = threshold_intensity_mw_cm2(c, supply_per_s);
  if (!(least > 0)) return c.oxygen_mol_l / radicals_mol_l_s(c, intensity_mw_cm2);
  return intensity_mw_cm2 > least ? -std::log1p(-least / intensity_mw_cm2) / supply_per_s : kNever;
}

double least_initiator_mol_l(const Chemistry& c) {
  return (c.oxygen_mol_l + c.inhibitor_mol_l) / 2;
}

double inhibited_radicals_mol_l(const Chemistry& c, double intensity_mw_cm2) {
  return radicals_mol_l_s(c, intensity_mw_cm2) / (c.oxygen_l_mol_s * c.oxygen_mol_l);
}

double steady_radicals_mol_l(const Chemistry& c, double intensity_mw_cm2) {
  return std::sqrt(radicals_mol_l_s(c, intensity_mw_cm2) / (2 * c.termination_l_mol_s));
}

double rise_time_s(const Chemistry& c, double intensity_mw_cm2) {
  return 1 / std::sqrt(2 * c.termination_l_mol_s * radicals_mol_l_s(c, intensity_mw_cm2));
}

double conversion_after_inhibition(const Chemistry& c, double intensity_mw_cm2, double seconds) {
  const double x = seconds / rise_time_s(c, intensity_mw_cm2);
  // ln cosh x without overflow.
  const double ln_cosh = x + std::log1p(std::exp(-2 * x)) - std::log(2.0);
  return -std::expm1(-c.propagation_l_mol_s / (2 * c.termination_l_mol_s) * ln_cosh);
}

double dark_conversion(const Chemistry& c, double intensity_mw_cm2, double seconds) {
  const double ended =
      2 * c.termination_l_mol_s * steady_radicals_mol_l(c, intensity_mw_cm2) * seconds;
  return -std::expm1(-c.propagation_l_mol_s / (2 * c.termination_l_mol_s) * std::log1p(ended));
}

GelTime gel_time_of(const Chemistry& c) {
  const double ri1 = radicals_mol_l_s(c, 1);
  const double ln_cosh =
      -2 * c.termination_l_mol_s / c.propagation_l_mol_s * std::log1p(-c.gel_conversion);
  return {(c.oxygen_mol_l + c.inhibitor_mol_l) / ri1,
          arcosh_of_exp(ln_cosh) / std::sqrt(2 * c.termination_l_mol_s * ri1)};
}

double gel_time_s(const GelTime& g, double intensity_mw_cm2) {
  return g.A / intensity_mw_cm2 + g.B / std::sqrt(intensity_mw_cm2);
}

double gel_intensity_mw_cm2(const GelTime& g, double seconds) {
  const double root = (g.B + std::sqrt(g.B * g.B + 4 * g.A * seconds)) / (2 * seconds);
  return root * root;
}

double local_exponent(const GelTime& g, double intensity_mw_cm2) {
  const double b = g.B * std::sqrt(intensity_mw_cm2);
  return (g.A + b / 2) / (g.A + b);
}

double gel_dose_mj_cm2(const GelTime& g, double intensity_mw_cm2) {
  return g.A + g.B * std::sqrt(intensity_mw_cm2);
}

double permeable_dead_zone_um(const Chemistry& c, double intensity_mw_cm2, double wall_mol_l) {
  return std::sqrt(2 * c.oxygen_um2_s.value_or(std::nan("")) * wall_mol_l /
                   radicals_mol_l_s(c, intensity_mw_cm2));
}

double permeable_dead_zone_um(const Chemistry& c, double intensity_mw_cm2, double wall_mol_l,
                              double height_um) {
  const double left = wall_mol_l * c.oxygen_um2_s.value_or(std::nan("")) /
                      (radicals_mol_l_s(c, intensity_mw_cm2) * height_um * height_um);
  if (std::isnan(left)) return left;
  if (left >= 1) return kNever;
  // 1 - (1+x) e^-x rises from 0 to 1 and is x²/2 near 0.
  const auto rest = [](double x) {
    return x < 1e-3 ? x * x * (0.5 - x / 3 + x * x / 8) : 1 - (1 + x) * std::exp(-x);
  };
  double high = 1;
  constexpr double low = 0;
  while (rest(high) < left) high *= 2;
  return height_um * halved({low, high}, 200, [&](double x) { return rest(x) < left; }).high;
}

double oxygen_used_mol_l(const Chemistry& c, double intensity_mw_cm2, FeatureShape shape,
                         double half_width_um, double seconds) {
  return radicals_mol_l_s(c, intensity_mw_cm2) *
         factor_integral_s(shape, half_width_um, c.oxygen_um2_s.value_or(std::nan("")), seconds);
}

double feature_inhibition_time_s(const Chemistry& c, double intensity_mw_cm2, FeatureShape shape,
                                 double half_width_um, double most_s) {
  const auto used = [&](double t) {
    return oxygen_used_mol_l(c, intensity_mw_cm2, shape, half_width_um, t);
  };
  double low = 0, high = inhibition_time_s(c, intensity_mw_cm2);
  while (used(high) < c.oxygen_mol_l) {
    low = high;
    high *= 2;
    if (high > most_s) return kNever;
  }
  return halved({low, high}, 200, [&](double t) { return used(t) < c.oxygen_mol_l; }).high;
}

}  // namespace slicecorr
