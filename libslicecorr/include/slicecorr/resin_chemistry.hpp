// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file resin_chemistry.hpp
/// The figures of a resin's chemistry, as its file says them. The equations that they belong to are in
/// chemistry.hpp. Plain values, thread-safe as such are.
#pragma once

#include <optional>
#include <string>

namespace slicecorr {

/// The table [chemistry] of a resin file, checked and in one set of units.
struct Chemistry {
  std::string family = {};              ///< such as acrylate; empty when not given
  double groups_mol_l = 0;              ///< P0(0), end groups that can be bonded, > 0
  double initiator_mol_l = 0;           ///< I(0), > 0
  double oxygen_mol_l = 0;              ///< O(0), >= 0
  double inhibitor_mol_l = 0;           ///< Q(0), >= 0
  double wavelength_nm = 0;             ///< of the light that `absorptivity_l_mol_cm` holds for
  double absorptivity_l_mol_cm = 0;     ///< eps of the initiator, base e, > 0
  double other_absorption_per_cm = 0;   ///< of everything else, base e, >= 0
  double quantum_yield = 0;             ///< phi, breaks per photon that the initiator takes, 0..1
  double initiation_l_mol_s = 0;        ///< kI of P0 and Ir, > 0
  double propagation_l_mol_s = 0;       ///< kp of P0 and P1, > 0
  double termination_l_mol_s = 0;       ///< kt of two P1, counting pairs, > 0
  double oxygen_l_mol_s = 0;            ///< ktO of P1 and O, >= 0
  double initiator_oxygen_l_mol_s = 0;  ///< kIO of Ir and O, >= 0
  double inhibitor_l_mol_s = 0;         ///< ktQ of P1 and Q, >= 0
  double gel_conversion = 0;            ///< Cg, 0..1, neither of them
  double temperature_k = 0;             ///< > 0
  /// Diffusivities; nothing where the file says neither them nor a radius with a viscosity.
  std::optional<double> initiator_um2_s = {}, radical_um2_s = {}, oxygen_um2_s = {},
                        inhibitor_um2_s = {};
  bool operator==(const Chemistry&) const = default;
};

/// Most that concentrations (mol/l), rate constants (l/(mol s)), absorptivity in any base (l/(mol cm)),
/// diffusivities (um²/s) and radii (1e-10 m) may be.
inline constexpr double kMostConcentration = 100, kMostRate = 1e13, kMostAbsorptivity = 1e7,
                        kMostDiffusivity = 1e6, kMostRadius = 1000;

/// Temperature where the file does not say it, K.
inline constexpr double kDefaultTemperatureK = 298.15;

/// Radius of an oxygen molecule where the file does not say it, 1e-10 m.
inline constexpr double kOxygenRadiusAngstrom = 2.16;

}  // namespace slicecorr
