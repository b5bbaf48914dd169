// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "process/chemistry_keys.hpp"

#include <fmt/format.h>

#include <cmath>

#include "slicecorr/chemistry.hpp"
#include "slicecorr/process.hpp"
#include "slicecorr/units.hpp"

namespace slicecorr::detail {

namespace {

/// A figure that may be 0 and need not be there.
double at_least_0(const TomlTable& table, const char* key, double most) {
  return table.number(key, 0, most, true).value_or(0);
}

double natural_absorptivity(const TomlTable& table) {
  const double eps = table.required_number("absorptivity_l_mol_cm", 0, kMostAbsorptivity);
  const toml::node* base = table.node("absorptivity_base");
  if (!base) {
    table.fail("absorptivity_base", "missing; expected 10, as spectrometers have it, or \"e\"");
  }
  const bool ten = (base->is_integer() && **base->as_integer() == 10) ||
                   (base->is_string() && **base->as_string() == "10");
  if (ten) return eps * units::kLn10;
  if (base->is_string() && **base->as_string() == "e") return eps;
  table.fail("absorptivity_base", "expected 10 or \"e\"");
}

double wavelength(const TomlTable& table, const TomlTable& cure) {
  constexpr double least = 100, most = 2000;
  const auto own = table.number("wavelength_nm", least, most, true);
  const auto of_cure = cure.number("wavelength_nm", 0, 1e5);
  if (own) return *own;
  if (!of_cure) table.fail("wavelength_nm", "missing, here and under [cure]; expected nm");
  if (*of_cure < least || *of_cure > most) {
    cure.fail("wavelength_nm",
              fmt::format("is {:g}; expected {:g} to {:g} nm", *of_cure, least, most));
  }
  return *of_cure;
}

/// Termination by pairs. Papers write the loss of radicals as 2 kt R² or as kt R²: a file says which.
double termination(const TomlTable& table) {
  const double kt = table.required_number("termination_l_mol_s", 0, kMostRate);
  const std::string counts = table.text("termination_counts", "");
  if (counts == "pairs") return kt;
  if (counts == "radicals") return kt / 2;
  table.fail(
      "termination_counts",
      fmt::format("{}; expected \"pairs\" where radicals vanish at 2 kt R², or "
                  "\"radicals\" where they vanish at kt R²",
                  table.has("termination_counts") ? fmt::format("is '{}'", counts) : "missing"));
}

/// How fast a species diffuses: said, or by its radius in a liquid of this viscosity.
std::optional<double> diffusivity(const TomlTable& table, const std::string& species,
                                  double temperature_k, double viscosity_pa_s,
                                  std::optional<double> usual_radius = {}) {
  const std::string said = species + "_diffusion_um2_s", by = species + "_radius_angstrom";
  const auto d = table.number(said, 0, kMostDiffusivity, true);
  auto radius = table.number(by, 0, kMostRadius);
  if (d && radius) table.fail(by, fmt::format("is given beside {}; expected one of them", said));
  if (d) return d;
  if (radius && !(viscosity_pa_s > 0)) {
    table.fail(by, fmt::format("says nothing without viscosity_pa_s; expected that, or {}", said));
  }
  if (!radius) radius = usual_radius;
  if (!radius || !(viscosity_pa_s > 0)) return std::nullopt;
  return stokes_einstein_um2_s(temperature_k, viscosity_pa_s, *radius);
}

}  // namespace

std::optional<Chemistry> chemistry_keys(const TomlTable& root, const TomlTable& cure,
                                        double viscosity_pa_s) {
  const toml::node* node = root.node("chemistry");
  if (!node || node->is_string()) return std::nullopt;
  const TomlTable table = root.required_table("chemistry");
  Chemistry c;
  c.family = table.text("family", "");
  c.groups_mol_l = table.required_number("groups_mol_l", 0, kMostConcentration);
  c.initiator_mol_l = table.required_number("initiator_mol_l", 0, kMostConcentration);
  if (!table.has("oxygen_mol_l")) {
    table.fail("oxygen_mol_l", "missing; expected what is dissolved, 0 where there is none");
  }
  c.oxygen_mol_l = at_least_0(table, "oxygen_mol_l", kMostConcentration);
  c.inhibitor_mol_l = at_least_0(table, "inhibitor_mol_l", kMostConcentration);
  c.wavelength_nm = wavelength(table, cure);
  c.absorptivity_l_mol_cm = natural_absorptivity(table);
  c.other_absorption_per_cm = at_least_0(table, "other_absorption_per_cm", 1e6);
  c.quantum_yield = table.required_number("quantum_yield", 0, 1);
  c.initiation_l_mol_s = table.required_number("initiation_l_mol_s", 0, kMostRate);
  c.propagation_l_mol_s = table.required_number("propagation_l_mol_s", 0, kMostRate);
  c.termination_l_mol_s = termination(table);
  const auto takes_radicals = [&](const char* what, const char* rate, double concentration) {
    const auto value = table.number(rate, 0, kMostRate, true);
    if (!value && concentration > 0) {
      table.fail(rate, fmt::format("missing, with {:g} mol/l of {}; expected l/(mol s)",
                                   concentration, what));
    }
    return value.value_or(0);
  };
  c.oxygen_l_mol_s = takes_radicals("oxygen", "oxygen_l_mol_s", c.oxygen_mol_l);
  c.inhibitor_l_mol_s = takes_radicals("inhibitor", "inhibitor_l_mol_s", c.inhibitor_mol_l);
  c.initiator_oxygen_l_mol_s = at_least_0(table, "initiator_oxygen_l_mol_s", kMostRate);
  c.gel_conversion = table.required_number("gel_conversion", 0, 1);
  if (c.gel_conversion >= 1) {
    table.fail("gel_conversion", "is 1; expected a share of the end groups between 0 and 1");
  }
  c.temperature_k = table.number("temperature_k", 0, 1000).value_or(kDefaultTemperatureK);
  const double mu = table.number("viscosity_pa_s", 0, kMostViscosity).value_or(viscosity_pa_s);
  const auto d = [&](const char* species, std::optional<double> usual = {}) {
    return diffusivity(table, species, c.temperature_k, mu, usual);
  };
  c.initiator_um2_s = d("initiator");
  c.radical_um2_s = d("radical");
  c.oxygen_um2_s = d("oxygen", kOxygenRadiusAngstrom);
  c.inhibitor_um2_s = d("inhibitor");
  return c;
}

}  // namespace slicecorr::detail
