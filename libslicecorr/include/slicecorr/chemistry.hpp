// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file chemistry.hpp
/// What resin does between light and solid: its chemistry as a resin file says it, and what follows
/// from it in closed form.
///
/// An initiator I breaks into two radicals Ir, which start chains at end groups. End groups are free
/// (P0), radicals (P1), bonded (P2) or dead (P3). Oxygen O and an added inhibitor Q take radicals
/// until they are used up. With i the intensity,
///
///     kd  = phi eps i / E,   E = NA h c / lambda        (eps in base e)
///     dI  = -kd I                                       dP2 = kp P0 P1 + 2 kt P1²
///     dIr = 2 kd I - kI P0 Ir - kIO Ir O                dP3 = ktO P1 O + ktQ P1 Q
///     dP0 = -kI P0 Ir - kp P0 P1                        dO  = -ktO P1 O - kIO Ir O
///     dP1 = kI P0 Ir - 2 kt P1² - ktO P1 O - ktQ P1 Q   dQ  = -ktQ P1 Q
///
/// and I, Ir, O and Q diffuse. P0 + P1 + P2 + P3 stays the same everywhere. Resin has gelled where
/// 1 - P0/P0(0) has reached the gel conversion. kt counts pairs of radicals: they vanish at 2 kt P1².
///
/// Units: concentrations mol/l, rate constants l/(mol s), times s, intensities mW/cm², diffusivities
/// um²/s. Plain functions, thread-safe. Arguments outside of the ranges that are said give NaN;
/// nothing throws.
#pragma once

#include "slicecorr/resin_chemistry.hpp"

namespace slicecorr {

/// E = NA h c / lambda, J/mol: energy of a mole of photons.
double photon_energy_j_mol(double wavelength_nm);
/// D = kB T / (6 pi mu r) of Stokes and Einstein, um²/s; too low for molecules as small as those of
/// the liquid: by half in water.
double stokes_einstein_um2_s(double temperature_k, double viscosity_pa_s, double radius_angstrom);

/// Height over which resin with all its initiator dims light to 1/e, um.
double light_height_um(const Chemistry& c);
/// Share of the light that a film takes up, and the mean over its thickness of the light in it, both
/// over the light that comes in, 0..1. `film_um` >= 0.
double absorbed_share(const Chemistry& c, double film_um);
double mean_light_share(const Chemistry& c, double film_um);

/// kd, 1/s, at an intensity.
double initiation_per_s(const Chemistry& c, double intensity_mw_cm2);
/// Ri = 2 kd I(0), mol/(l s): primary radicals while the initiator is not used up.
double radicals_mol_l_s(const Chemistry& c, double intensity_mw_cm2);

/// Time in which radicals use up oxygen and inhibitor, (O + Q) / Ri: the inhibitor as quick as oxygen.
double inhibition_time_s(const Chemistry& c, double intensity_mw_cm2);
/// The same with an initiator that is used up: -ln(1 - (O + Q) / 2I) / kd; infinite where it gives
/// less radicals than there are of oxygen and inhibitor.
double inhibition_time_used_up_s(const Chemistry& c, double intensity_mw_cm2);
/// The same of resin whose oxygen is resupplied from outside at a rate of `supply_per_s` (O(0) - O),
/// without inhibitor: -ln(1 - i_th/i) / ks; infinite up to the threshold intensity.
double inhibition_time_supplied_s(const Chemistry& c, double intensity_mw_cm2, double supply_per_s);
/// i_th = ks O(0) / Ri(1), mW/cm²: light up to it never uses up oxygen that is so supplied.
double threshold_intensity_mw_cm2(const Chemistry& c, double supply_per_s);
/// Least I(0), mol/l, whose radicals use up oxygen and inhibitor: (O + Q) / 2.
double least_initiator_mol_l(const Chemistry& c);

/// P1 while there is oxygen, Ri / (ktO O): at its start.
double inhibited_radicals_mol_l(const Chemistry& c, double intensity_mw_cm2);
/// Ps = sqrt(Ri / 2kt), and the time tau = 1 / sqrt(2 kt Ri) in which P1 rises to it: Ps tanh(t/tau).
double steady_radicals_mol_l(const Chemistry& c, double intensity_mw_cm2);
double rise_time_s(const Chemistry& c, double intensity_mw_cm2);
/// Share of the end groups used up so long after inhibition, 1 - cosh(t/tau)^(-kp/2kt).
double conversion_after_inhibition(const Chemistry& c, double intensity_mw_cm2, double seconds);
/// Share of the end groups that are left which cures so long after light at steady state has gone:
/// 1 - (1 + 2 kt Ps t)^(-kp/2kt).
double dark_conversion(const Chemistry& c, double intensity_mw_cm2, double seconds);

/// t_gel = A / i + B / sqrt(i).
struct GelTime {
  double A = 0;  ///< mJ/cm², what inhibition takes: (O + Q) / Ri(1)
  double B = 0;  ///< (mW/cm²)^½ s: arcosh((1-Cg)^(-2kt/kp)) / sqrt(2 kt Ri(1))
  bool operator==(const GelTime&) const = default;
};
GelTime gel_time_of(const Chemistry& c);
double gel_time_s(const GelTime& g, double intensity_mw_cm2);
/// Intensity that gels in so many seconds: ((B + sqrt(B² + 4At)) / 2t)².
double gel_intensity_mw_cm2(const GelTime& g, double seconds);
/// Local exponent m of I^m t = const, (A + B sqrt(i)/2) / (A + B sqrt(i)): from 1, where inhibition
/// rules, to 1/2, where radicals end each other.
double local_exponent(const GelTime& g, double intensity_mw_cm2);
/// Gel dose at an intensity, mJ/cm²: A + B sqrt(i).
double gel_dose_mj_cm2(const GelTime& g, double intensity_mw_cm2);

/// Dead zone above a permeable window at which oxygen is held at `wall_mol_l`: in even light
/// sqrt(2 D O / Ri), um.
double permeable_dead_zone_um(const Chemistry& c, double intensity_mw_cm2, double wall_mol_l);
/// The same in light that falls to 1/e over `height_um`: O D / (Ri h²) = 1 - (1+x) e^(-x), with x the
/// depth over the height. Infinite where the light's radicals do not suffice anywhere.
double permeable_dead_zone_um(const Chemistry& c, double intensity_mw_cm2, double wall_mol_l,
                              double height_um);

/// Oxygen used up by a single feature in the dark while none is short, at its centre: O(0) less this
/// many mol/l, Ri times the integral of f over time, f = erf(a / sqrt(4 D s)) for a line of half
/// width a, its square for a square, 1 - exp(-a²/4Ds) for a disc.
enum class FeatureShape { line, square, disc };
double oxygen_used_mol_l(const Chemistry& c, double intensity_mw_cm2, FeatureShape shape,
                         double half_width_um, double seconds);
/// Time at which it is all used up there; infinite where diffusion always brings enough (up to
/// `most_s`).
double feature_inhibition_time_s(const Chemistry& c, double intensity_mw_cm2, FeatureShape shape,
                                 double half_width_um, double most_s = 1e6);

}  // namespace slicecorr
