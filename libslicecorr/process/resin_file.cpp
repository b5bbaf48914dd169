// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <fmt/format.h>

#include <cmath>
#include <filesystem>
#include <optional>
#include <string>

#include "process/chemistry_keys.hpp"
#include "process/spread_keys.hpp"
#include "process/tomography_keys.hpp"
#include "process/unit_key.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/light_unit.hpp"
#include "slicecorr/process.hpp"
#include "slicecorr/same_light.hpp"
#include "slicecorr/turbidity.hpp"
#include "slicecorr/units.hpp"
#include "support/files/text_file.hpp"
#include "support/toml/toml_table.hpp"

namespace slicecorr {

namespace {

namespace fs = std::filesystem;

Inhibition inhibition_of(const TomlTable& table, const Resin& resin) {
  Inhibition i;
  i.beta = table.required_number("beta", 0, 1e6);
  i.absorbance_height10_um = detail::absorbance_height10(table);
  i.m = table.number("m", 0, 2).value_or(resin.m);
  i.wavelength_nm = table.number("wavelength_nm", 0, 1e5).value_or(0);
  const auto prime = table.number("critical_dose_prime", 0, 1e9);
  i.critical_dose_prime = prime.value_or(0);
  if (i.absorbance_height10_um >= resin.absorbance_height10_um) {
    // In the base of this table, which need not be that of the curing light's.
    const double written_um = *table.number("absorbance_height_um", 0, 1e9);
    table.fail("absorbance_height_um",
               fmt::format("is {:g} um; expected less than the curing light's, {:g} um in "
                           "the same base: without that there is no dead zone at the window",
                           written_um,
                           written_um * resin.absorbance_height10_um / i.absorbance_height10_um));
  }
  return i;
}

Bleaching bleaching_of(const TomlTable& table, const Resin& resin) {
  if (resin.model == CureModelKind::gel_time || resin.m != 1.0) {
    table.fail(
        "dose_mj_cm2",
        "is of a resin whose dose is not its intensity times its time; expected a resin of model "
        "\"jacobs\", or \"kinetic\" with m = 1");
  }
  Bleaching b;
  b.absorbance_height10_um = detail::absorbance_height10(table);
  b.dose_mj_cm2 = table.required_number("dose_mj_cm2", 0, 1e9);
  if (b.absorbance_height10_um < resin.absorbance_height10_um) {
    const double written_um = *table.number("absorbance_height_um", 0, 1e9);
    table.fail(
        "absorbance_height_um",
        fmt::format("is {:g} um; expected at least that of the fresh resin, {:g} um in the same "
                    "base: what bleaches lets more light pass",
                    written_um,
                    written_um * resin.absorbance_height10_um / b.absorbance_height10_um));
  }
  return b;
}

std::string only_for_m_1(const Resin& resin) {
  if (is_relative(resin)) {
    return fmt::format(
        "is \"{}\"; a dose in mJ/cm³ can't replace one in seconds of full light; expected a dose "
        "factor, which scales that of any resin",
        unit_in_files(resin.unit));
  }
  if (resin.model == CureModelKind::gel_time) {
    return "is \"gel-time\"; a dose in mJ/cm³ can't replace its two numbers; expected a dose factor, "
           "which scales that of any resin";
  }
  return fmt::format(
      "is {:g}; a dose in mJ/cm³ can only replace that of a resin with m = 1; expected a dose "
      "factor, which scales that of any resin",
      resin.m);
}

/// With what a resin was tuned: "PRINTER, LIGHT to LIGHT mW/cm2: ha, light, ...: matrix".
std::string tuned_with(const TomlTable& root) {
  const auto provenance = root.table("provenance");
  if (!provenance || !provenance->has("tuning")) return {};
  const std::string note = provenance->text("tuning", "");
  const std::size_t end = note.rfind(kTunedFigures);
  return end == std::string::npos ? std::string() : note.substr(0, end);
}

/// Takes A and B of a resin of model gel-time.
void resolve_gel_time(const TomlTable& cure, std::optional<double> dose_override, Resin& resin) {
  for (const char* key : {"m", "gel_dose_mj_cm3", "gel_dose_mj_cm2", "critical_dose_mj_cm3",
                          "critical_dose_mj_cm2", "critical_dose_prime"}) {
    if (cure.has(key)) {
      cure.fail(key,
                "does not go with model = \"gel-time\"; expected gel_a_mj_cm2 and "
                "gel_b_sqrt_mw_cm2_s alone");
    }
  }
  const auto figure = [&](const char* key) {
    const auto value = cure.number(key, 0, 1e9, true);
    if (!value) cure.fail(key, "missing; a resin of model \"gel-time\" needs it");
    return *value;
  };
  const double a = figure("gel_a_mj_cm2"), b = figure("gel_b_sqrt_mw_cm2_s");
  if (a == 0 && b == 0) {
    cure.fail("gel_a_mj_cm2", "is 0, and so is gel_b_sqrt_mw_cm2_s; expected one of them above 0");
  }
  const double factor = cure.number("dose_factor", 0, 1e3).value_or(kDefaultDoseFactor);
  resin.dose_factor = factor;
  if (a > 0 && b > 0) {
    if (dose_override) cure.fail("model", only_for_m_1(resin));
    resin.gel_a_mj_cm2 = a * factor;
    resin.gel_b_sqrt_mw_cm2_s = b * factor;
    return;
  }
  // What is left are the two laws that all else knows.
  if (b > 0) {
    resin.model = CureModelKind::kinetic;
    resin.m = 0.5;
    if (dose_override) cure.fail("gel_a_mj_cm2", only_for_m_1(resin));
    resin.critical_dose_prime = b * factor;
    return;
  }
  resin.model = CureModelKind::jacobs;
  resin.gel_dose_mj_cm3 = units::volumetric_from_areal(a, dose_height_e_um(resin));
  resin.areal_gel_dose = resin.areal_critical_dose = true;
  resin.critical_dose_mj_cm3 = dose_override.value_or(resin.gel_dose_mj_cm3 * factor);
  resin.dose_factor = resin.critical_dose_mj_cm3 / resin.gel_dose_mj_cm3;
}

void resolve_dose(const TomlTable& cure, std::optional<double> dose_override, Resin& resin) {
  const double height_e_um = dose_height_e_um(resin);
  const auto areal_or_volumetric = [&](const char* volumetric, const char* areal) {
    const auto v = cure.number(volumetric, 0, 1e9);
    const auto s = cure.number(areal, 0, 1e9);
    if (v && s)
      cure.fail(areal, fmt::format("is given beside {}; expected one of them", volumetric));
    if (s) return std::optional(units::volumetric_from_areal(*s, height_e_um));
    return v;
  };
  const auto gel = areal_or_volumetric("gel_dose_mj_cm3", "gel_dose_mj_cm2");
  const auto factor = cure.number("dose_factor", 0, 1e3);
  const auto critical = areal_or_volumetric("critical_dose_mj_cm3", "critical_dose_mj_cm2");
  const auto prime = cure.number("critical_dose_prime", 0, 1e9);
  if (gel) resin.gel_dose_mj_cm3 = *gel;
  resin.areal_gel_dose = cure.has("gel_dose_mj_cm2");
  if (resin.m != 1.0) {
    // Intensity times time says nothing here: D'c alone counts.
    if (dose_override) cure.fail("m", only_for_m_1(resin));
    if (!prime) {
      cure.fail("critical_dose_prime", "missing; a resin with m other than 1 needs it");
    }
    resin.critical_dose_prime = *prime * factor.value_or(1.0);
  } else if (dose_override) {
    resin.critical_dose_mj_cm3 = *dose_override;
  } else if (critical) {
    resin.critical_dose_mj_cm3 = *critical;
    resin.areal_critical_dose = cure.has("critical_dose_mj_cm2");
  } else if (prime && resin.model == CureModelKind::kinetic) {
    resin.critical_dose_prime = *prime * factor.value_or(1.0);
    resin.critical_dose_mj_cm3 =
        units::volumetric_from_areal(resin.critical_dose_prime, height_e_um);
  } else if (gel) {
    // Correcting with the gel dose itself loses features (dissertation §2.3.2).
    resin.critical_dose_mj_cm3 = *gel * factor.value_or(kDefaultDoseFactor);
    resin.areal_critical_dose = resin.areal_gel_dose;
  } else {
    cure.fail("critical_dose_mj_cm3",
              "missing; expected a critical dose, or gel_dose_mj_cm3 with its dose_factor");
  }
  if (resin.critical_dose_prime > 0) {
    resin.dose_factor = factor.value_or(1.0);
  } else if (gel) {
    resin.dose_factor = resin.critical_dose_mj_cm3 / *gel;
  }
}

/// Takes the dose of a resin whose light is told in shares of the brightest level's, and refuses what
/// needs mW/cm².
void resolve_relative(const TomlTable& root, const TomlTable& cure, const ResinOverrides& overrides,
                      Resin& resin) {
  if (resin.model != CureModelKind::jacobs) {
    cure.fail("unit",
              fmt::format("is \"{}\", which goes with model = \"jacobs\" alone; expected that",
                          unit_in_files(resin.unit)));
  }
  for (const char* table : {"inhibition", "bleaching", "chemistry"}) {
    if (!root.has(table) || (std::string_view(table) == "chemistry" && !root.table(table)))
      continue;
    cure.fail(
        "unit",
        fmt::format("is \"{}\", and the file has a [{}], which counts light in mW/cm²; expected "
                    "one of both",
                    unit_in_files(resin.unit), table));
  }
  for (const char* key : {"gel_dose_mj_cm3", "gel_dose_mj_cm2", "critical_dose_mj_cm3",
                          "critical_dose_mj_cm2", "critical_dose_prime", "dose_factor"}) {
    if (!cure.has(key)) continue;
    cure.fail(key, fmt::format("does not go with unit = \"{}\"; expected critical_dose_s alone",
                               unit_in_files(resin.unit)));
  }
  for (const char* key : {"inhibition_dose_mj_cm3", "inhibition_resupply_mj_cm3_s"}) {
    if (!cure.has(key) && !root.has(key)) continue;
    cure.fail(cure.has(key) ? key : "unit",
              fmt::format("does not go with unit = \"{}\" and {}; expected one of both",
                          unit_in_files(resin.unit), key));
  }
  if (overrides.dc_mj_cm3) cure.fail("unit", only_for_m_1(resin));
  resin.display = cure.text("display", "");
  resin.critical_dose_mj_cm3 = units::volumetric_from_areal(
      cure.required_number("critical_dose_s", 0, 1e9), dose_height_e_um(resin));
}

/// Gives the resin another absorbance height. What cures goes on absorbing as it did.
void take_height(Resin& resin, double height10_um) {
  resin.absorbance_height10_um = height10_um;
  if (resin.bleaches() && resin.bleaching->absorbance_height10_um < height10_um) {
    throw InputError(
        resin.name, "bleaching.absorbance_height_um",
        fmt::format("is {:g} um in base 10; expected at least the {:g} um of the fresh resin that "
                    "were asked for",
                    resin.bleaching->absorbance_height10_um, height10_um));
  }
  if (resin.active_absorption_per_cm > absorption_per_cm(resin)) {
    throw InputError(
        resin.name, "active_absorption_per_cm",
        fmt::format("is {:g} per cm; the absorbance height of {:g} um (base 10) that was asked for "
                    "is an absorption of {:g} per cm in all; expected at most {:g} um",
                    resin.active_absorption_per_cm, height10_um, absorption_per_cm(resin),
                    units::height10_from_e(
                        units::height_e_from_absorption_per_cm(resin.active_absorption_per_cm))));
  }
}

Shrinkage shrinkage_of(const TomlTable& root) {
  Shrinkage s;
  if (const auto table = root.table("shrinkage")) {
    const auto share = [&](const char* key) {
      return table->number(key, Shrinkage::kLeast, Shrinkage::kMost, true).value_or(0);
    };
    s.plane_per_cent = share("plane");
    s.z_per_cent = share("z");
  }
  if (const auto table = root.table("first_layers")) {
    s.growth_um = table->number("growth_um", 0, Shrinkage::kMostGrowthUm, true).value_or(0);
    const auto height_um = table->number("height_um", 0, Shrinkage::kMostHeightUm);
    if (s.grows()) s.height_um = height_um.value_or(Shrinkage::kDefaultHeightUm);
  }
  return s;
}

/// A value that replaces one of the file's keeps to the same limits.
void check_override(const std::optional<double>& value, const char* what, double most) {
  if (value && !(*value > 0 && *value <= most)) {
    throw InputError(
        fmt::format("{} is {:g}; expected a number above 0 and at most {:g}", what, *value, most));
  }
}

void check_overrides(const ResinOverrides& overrides) {
  check_override(overrides.ha_um, "the absorbance height, um,", 1e7);
  check_override(overrides.dc_mj_cm3, "the dose to aim at, mJ/cm³,", 1e9);
  check_override(overrides.dose_factor, "the dose factor", 1e3);
  if (overrides.dc_mj_cm3 && overrides.dose_factor) {
    throw InputError(
        "a dose to aim at and a dose factor are two ways to set the dose; expected one of them");
  }
}

/// Aims at `factor` times the gel dose; where only one dose is known, at so many times that.
void scale_dose(Resin& resin, double factor) {
  const double change = factor / resin.dose_factor;
  resin.critical_dose_mj_cm3 *= change;
  resin.critical_dose_prime *= change;
  resin.gel_a_mj_cm2 *= change;
  resin.gel_b_sqrt_mw_cm2_s *= change;
  resin.dose_factor = factor;
}

}  // namespace

Resin parse_resin(std::string_view text, const std::string& source,
                  const ResinOverrides& overrides) {
  const toml::table root_table = parse_toml(text, source);
  const TomlTable root(root_table, source);
  Resin resin;
  resin.name = root.text("name", fs::path(source).stem().string());
  resin.unread = unread_words(text, source, "resin");
  const TomlTable cure = root.required_table("cure");
  const std::string model = cure.text("model", "jacobs");
  if (model != "jacobs" && model != "kinetic" && model != "gel-time") {
    cure.fail("model",
              fmt::format("is '{}'; expected \"jacobs\", \"kinetic\" or \"gel-time\"", model));
  }
  resin.model = model == "gel-time"  ? CureModelKind::gel_time
                : model == "kinetic" ? CureModelKind::kinetic
                                     : CureModelKind::jacobs;
  resin.unit = detail::unit_key(cure);
  resin.m = cure.number("m", 0, 2).value_or(1.0);
  if (resin.model == CureModelKind::jacobs && resin.m != 1.0) {
    cure.fail("m",
              fmt::format("is {:g}; the Jacobs model has m = 1, others are \"kinetic\"", resin.m));
  }
  const detail::LightKeys light = detail::light_keys(root, cure);
  resin.absorbance_height10_um = light.height10_um;
  resin.active_absorption_per_cm = light.active_absorption_per_cm;
  resin.n = light.n;
  resin.inhibition_dose_mj_cm3 = light.inhibition_dose_mj_cm3;
  resin.inhibition_resupply_mj_cm3_s = light.inhibition_resupply_mj_cm3_s;
  resin.dose_diffusion_m2_s = light.dose_diffusion_m2_s;
  resin.scatter_um2_per_um = light.scatter_um2_per_um;
  resin.turbidity = light.turbidity;
  resin.viscosity_pa_s = light.viscosity_pa_s;
  if (const auto strength = cure.number("green_strength", 1, 10, true)) {
    resin.green_strength = *strength;
  }
  if (light.inhibitor_life_s) resin.inhibitor_life_s = *light.inhibitor_life_s;
  resin.wavelength_nm = cure.number("wavelength_nm", 0, 1e5).value_or(0);
  resin.tuned_with = tuned_with(root);
  check_overrides(overrides);
  for (const char* key : {"critical_dose_s", "display"}) {
    if (is_relative(resin) || !cure.has(key)) continue;
    cure.fail(key, fmt::format("is for unit = \"{}\"; expected it beside that",
                               unit_in_files(LightUnit::brightest)));
  }
  if (is_relative(resin)) {
    resolve_relative(root, cure, overrides, resin);
  } else if (resin.model == CureModelKind::gel_time) {
    resolve_gel_time(cure, overrides.dc_mj_cm3, resin);
  } else {
    for (const char* key : {"gel_a_mj_cm2", "gel_b_sqrt_mw_cm2_s"}) {
      if (cure.has(key)) cure.fail(key, "is for model = \"gel-time\"");
    }
    resolve_dose(cure, overrides.dc_mj_cm3, resin);
  }
  if (const auto table = root.table("inhibition")) {
    if (model == "gel-time") {
      cure.fail("model",
                "is \"gel-time\", and the file has an [inhibition]; expected one of both: "
                "the dose under UV light follows the kinetic law");
    }
    resin.inhibition = inhibition_of(*table, resin);
  }
  if (const auto table = root.table("bleaching")) {
    if (root.has("chemistry") && root.table("chemistry")) {
      table->fail(
          "dose_mj_cm2",
          "stands beside a [chemistry], whose light falls by Beer's law; expected one of both");
    }
    resin.bleaching = bleaching_of(*table, resin);
  }
  resin.shrinkage = shrinkage_of(root);
  resin.chemistry = detail::chemistry_keys(root, cure, resin.viscosity_pa_s);
  if (resin.chemistry) refuse_turbidity(resin, "a resin with [chemistry]");
  return with_overrides(std::move(resin), overrides);
}

void refuse_shrinkage(const Resin& resin, const char* what) {
  if (!resin.shrinkage.any()) return;
  throw InputError(resin.name, resin.shrinkage.shrinks() ? "shrinkage" : "first_layers",
                   fmt::format("is not counted in {}; expected a resin without it", what));
}

double absorption_per_cm(const Resin& resin) {
  return units::absorption_per_cm_from_height_e(
      units::height_e_from_10(resin.absorbance_height10_um));
}

double curing_absorption_per_cm(const Resin& resin) {
  return resin.active_absorption_per_cm > 0 ? resin.active_absorption_per_cm
                                            : absorption_per_cm(resin);
}

double dose_height_e_um(const Resin& resin) {
  return resin.active_absorption_per_cm > 0
             ? units::height_e_from_absorption_per_cm(resin.active_absorption_per_cm)
             : units::height_e_from_10(resin.absorbance_height10_um);
}

Resin with_overrides(Resin resin, const ResinOverrides& overrides) {
  check_overrides(overrides);
  if (overrides.ha_um) {
    const double before_um = dose_height_e_um(resin);
    take_height(resin, *overrides.ha_um);
    // What was told of a surface stays so: D'c and seconds of full light always.
    const double change = before_um / dose_height_e_um(resin);
    const bool areal =
        resin.areal_critical_dose || is_relative(resin) || resin.critical_dose_prime > 0;
    if (areal) resin.critical_dose_mj_cm3 *= change;
    if (resin.areal_gel_dose) resin.gel_dose_mj_cm3 *= change;
    if (areal != resin.areal_gel_dose && resin.gel_dose_mj_cm3 > 0 &&
        resin.critical_dose_mj_cm3 > 0 && resin.critical_dose_prime == 0) {
      resin.dose_factor = resin.critical_dose_mj_cm3 / resin.gel_dose_mj_cm3;
    }
  }
  if (overrides.dc_mj_cm3) {
    if (resin.has_gel_time()) throw InputError(resin.name, "model", only_for_m_1(resin));
    if (is_relative(resin)) throw InputError(resin.name, "unit", only_for_m_1(resin));
    if (resin.m != 1.0) throw InputError(resin.name, "m", only_for_m_1(resin));
    resin.critical_dose_mj_cm3 = *overrides.dc_mj_cm3;
    resin.areal_critical_dose = false;
    resin.critical_dose_prime = 0;
    resin.dose_factor =
        resin.gel_dose_mj_cm3 > 0 ? resin.critical_dose_mj_cm3 / resin.gel_dose_mj_cm3 : 1;
  }
  if (overrides.dose_factor) scale_dose(resin, *overrides.dose_factor);
  return resin;
}

Resin load_resin(const std::string& name_or_path, const ResinOverrides& overrides) {
  const std::string path = find_definition(name_or_path, "resin");
  return parse_resin(read_text_file(path), path, overrides);
}

}  // namespace slicecorr
