// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "describe.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "describe_lines.hpp"
#include "slicecorr/chemistry.hpp"
#include "slicecorr/gel_time.hpp"
#include "slicecorr/light_unit.hpp"
#include "slicecorr/units.hpp"
#include "slicecorr/vial.hpp"

namespace slicecorr::resinctl {

namespace {

using namespace resins;

/// How many characters a UTF-8 text has.
std::size_t width_of(const std::string& text) {
  return static_cast<std::size_t>(
      std::count_if(text.begin(), text.end(), [](char c) { return (c & 0xC0) != 0x80; }));
}

/// Four digits, without an exponent for large numbers.
std::string four_digits(double value) {
  return value >= 1e4 && value < 1e15 ? fmt::format("{:.0f}", value) : fmt::format("{:.4g}", value);
}

/// A dose analogue in its unit.
std::string prime(double value, double m, LightUnit unit = LightUnit::mw_cm2) {
  return m == 1.0 ? fmt::format("{} {}", four_digits(value), unit_of_dose(unit))
                  : fmt::format("{} (mW/cm²)^{:g}·s", four_digits(value), m);
}

bool gel_is_known(const ResinRecord& r) {
  if (r.resin.gel_dose_mj_cm3 > 0 || r.resin.has_gel_time() || is_relative(r.resin)) return true;
  // Without a factor, a kinetic file gives the dose aimed at.
  return r.resin.critical_dose_prime > 0 && r.text.find("dose_factor") != std::string::npos;
}

/// A and B of a time to gel, `times` as long.
std::string gel_time_text(const Resin& resin, double times) {
  return fmt::format("{}/i + {}/sqrt(i) s", four_digits(times * resin.gel_a_mj_cm2),
                     four_digits(times * resin.gel_b_sqrt_mw_cm2_s));
}

std::string dose_line(const char* what, const ResinFigures& f, const Resin& resin, bool aim) {
  const double m = resin.m;
  if (is_relative(resin)) {
    return line(what, fmt::format("{} {} areal", four_digits(aim ? f.aim_mj_cm2 : f.gel_mj_cm2),
                                  unit_of_dose(resin.unit)));
  }
  if (m == 1.0) {
    return line(what, fmt::format("{} mJ/cm² areal, {} mJ/cm³ volumetric",
                                  four_digits(aim ? f.aim_mj_cm2 : f.gel_mj_cm2),
                                  four_digits(aim ? f.aim_mj_cm3 : f.gel_mj_cm3)));
  }
  return line(what,
              fmt::format("{} (mW/cm²)^{:g}·s areal, {} (mW/cm³)^{:g}·s volumetric",
                          four_digits(aim ? f.aim_prime : f.gel_prime), m,
                          four_digits(aim ? f.aim_prime_volumetric : f.gel_prime_volumetric), m));
}

std::string in_plain_words(const ResinRecord& r, const ResinFigures& f) {
  const double m = r.resin.m;
  std::string out = "\nWhat correction aims at\n";
  if (r.resin.has_gel_time()) {
    const GelTime g{r.resin.gel_a_mj_cm2, r.resin.gel_b_sqrt_mw_cm2_s};
    const double even = std::pow(g.A / g.B, 2);
    return out +
           fmt::format(
               "  Light of i mW/cm² gels the resin in {}; correction aims at {:.4g} times that.\n"
               "  Below {:.3g} mW/cm² the dose rules (m near 1), above it the root of the "
               "intensity (m near 1/2):\n"
               "  at 1, 10 and 100 mW/cm² m is {:.3f}, {:.3f} and {:.3f}.\n",
               gel_time_text(r.resin, 1 / f.dose_factor), f.dose_factor, even, local_exponent(g, 1),
               local_exponent(g, 10), local_exponent(g, 100));
  }
  if (is_relative(r.resin)) {
    return out +
           fmt::format(
               "  {}: the brightest level of the printer gels a surface in that time. Doses are "
               "in its unit, and go with its file alone.\n",
               prime(f.aim_prime, m, r.resin.unit));
  }
  if (gel_is_known(r)) {
    out += fmt::format(
        "  The resin gels at {}. Correction aims at {:.4g} times that, {}:\n"
        "  aiming at the gel dose itself loses fine features.\n",
        prime(f.gel_prime, m), f.dose_factor, prime(f.aim_prime, m));
  } else {
    out += fmt::format(
        "  Correction aims at {}. The file gives this dose itself, not a gel dose with a factor.\n",
        prime(f.aim_prime, m));
  }
  if (m == 1.0) {
    out += fmt::format("  In options of slicecorr: --dc-mj-cm3 {:.6g} --ha-um {:.6g}\n",
                       f.aim_mj_cm3, f.height10_um);
  } else {
    out += fmt::format(
        "  m = {:g}: twice the intensity needs {:.3g} times the exposure, not half of it.\n", m,
        std::pow(2.0, -m));
  }
  return out;
}

}  // namespace

std::string line(const char* what, const std::string& value) {
  return value.empty() ? "" : fmt::format("  {:<22}{}\n", what, value);
}

/// Four digits, without an exponent for large numbers.

std::string provenance_text(const std::map<std::string, std::string>& provenance) {
  std::string out;
  for (const auto& [key, value] : provenance) out += line(key.c_str(), value);
  return out.empty() ? "" : "\nWhere it comes from\n" + out;
}

std::string aligned(const std::vector<std::vector<std::string>>& rows) {
  std::vector<std::size_t> widths;
  for (const auto& row : rows) {
    widths.resize(std::max(widths.size(), row.size()));
    for (std::size_t i = 0; i < row.size(); ++i) widths[i] = std::max(widths[i], width_of(row[i]));
  }
  std::string out;
  for (const auto& row : rows) {
    std::string text;
    for (std::size_t i = 0; i < row.size(); ++i) {
      text += row[i] + std::string(widths[i] - width_of(row[i]) + 2, ' ');
    }
    text.erase(text.find_last_not_of(' ') + 1);
    out += text + "\n";
  }
  return out;
}

std::string gel_dose_text(const ResinRecord& r) {
  if (r.resin.has_gel_time()) return gel_time_text(r.resin, 1 / r.resin.dose_factor);
  return gel_is_known(r) ? prime(figures_of(r.resin).gel_prime, r.resin.m, r.resin.unit) : "-";
}

std::string aim_text(const ResinRecord& r) {
  const ResinFigures f = figures_of(r.resin);
  if (r.resin.has_gel_time()) return fmt::format("{:.4g} x gel", f.dose_factor);
  const std::string dose = prime(f.aim_prime, r.resin.m, r.resin.unit);
  return gel_is_known(r) ? fmt::format("{} ({:.4g} x gel)", dose, f.dose_factor) : dose;
}

namespace {

std::string chemistry_text(const Chemistry& c) {
  std::string out = "\nChemistry\n";
  out += line("end groups", fmt::format("{:.4g} mol/l; gels when {:.4g} % of them are used up",
                                        c.groups_mol_l, 100 * c.gel_conversion));
  out += line("initiator",
              fmt::format("{:.4g} mol/l, {:.4g} l/(mol cm) base 10 at {:g} nm, quantum yield {:g}",
                          c.initiator_mol_l, c.absorptivity_l_mol_cm / units::kLn10,
                          c.wavelength_nm, c.quantum_yield));
  out += line("oxygen", fmt::format("{:.4g} mol/l", c.oxygen_mol_l));
  if (c.inhibitor_mol_l > 0)
    out += line("inhibitor", fmt::format("{:.4g} mol/l", c.inhibitor_mol_l));
  out += line("rates, l/(mol s)",
              fmt::format("initiation {:.4g}, propagation {:.4g}, termination {:.4g} (of pairs: "
                          "chains vanish at twice this)",
                          c.initiation_l_mol_s, c.propagation_l_mol_s, c.termination_l_mol_s));
  out += line(
      "", fmt::format(
              "chains with oxygen {:.4g}{}{}", c.oxygen_l_mol_s,
              c.initiator_oxygen_l_mol_s > 0
                  ? fmt::format(", initiator with oxygen {:.4g}", c.initiator_oxygen_l_mol_s)
                  : "",
              c.inhibitor_mol_l > 0 ? fmt::format(", with inhibitor {:.4g}", c.inhibitor_l_mol_s)
                                    : ""));
  const auto d = [](const char* what, const std::optional<double>& um2_s) {
    return um2_s ? fmt::format("{} {:.4g}", what, *um2_s) : fmt::format("{} not given", what);
  };
  out += line("diffusion, um²/s",
              fmt::format("{}, {}, {}{} at {:g} K", d("oxygen", c.oxygen_um2_s),
                          d("initiator", c.initiator_um2_s), d("its radicals", c.radical_um2_s),
                          c.inhibitor_mol_l > 0 ? ", " + d("inhibitor", c.inhibitor_um2_s) : "",
                          c.temperature_k));
  out += line("dims light", fmt::format("to 1/e over {} um", four_digits(light_height_um(c))));
  const GelTime g = gel_time_of(c);
  out += line("time to gel, s", fmt::format("{:.4g} / I + {:.4g} / sqrt(I), I in mW/cm²: oxygen "
                                            "first, then chains",
                                            g.A, g.B));
  for (const double i : {1.0, 10.0, 100.0}) {
    out += line("", fmt::format("at {:g} mW/cm² {} s, of which {} s inhibited; local m = {:.3f}", i,
                                four_digits(gel_time_s(g, i)), four_digits(inhibition_time_s(c, i)),
                                local_exponent(g, i)));
  }
  if (inhibition_time_used_up_s(c, 1) > 1e300) {
    out += line("", fmt::format("it never gels: radicals of all initiator do not use up oxygen and "
                                "inhibitor; {:.4g} mol/l would",
                                least_initiator_mol_l(c)));
  }
  return out;
}

}  // namespace

std::string describe_resin(const ResinRecord& r) {
  const ResinFigures f = figures_of(r.resin);
  const double m = r.resin.m;
  std::string out = fmt::format("{}   resin, version {}\n", r.name, r.version);
  out += line("maker", r.maker) + line("product", r.product) +
         line("also called", fmt::format("{}", fmt::join(r.aliases, ", "))) +
         line("kind", fmt::format("{}", fmt::join(r.tags, ", "))) + line("chemistry", r.chemistry) +
         line("colour", r.colour) + line("notes", r.notes);
  out += line("file", r.path);
  out += "\nCuring\n";
  out +=
      line("model", r.resin.has_gel_time()                    ? "time to gel, A/i + B/sqrt(i)"
                    : r.resin.model == CureModelKind::kinetic ? fmt::format("kinetic, m = {:g}", m)
                                                              : "Jacobs' working curve, m = 1");
  if (r.wavelength_nm > 0) out += line("wavelength", fmt::format("{:g} nm", r.wavelength_nm));
  out += line("absorbance height", fmt::format("{:.5g} um base e (light falls to 1/e), {:.5g} um "
                                               "base 10 (to 1/10)",
                                               f.height_e_um, f.height10_um));
  const double all = absorption_per_cm(r.resin), cures = curing_absorption_per_cm(r.resin);
  out += line("absorption",
              cures < all ? fmt::format("{:.4g} per cm in base e, of which {:.4g} cure", all, cures)
                          : fmt::format("{:.4g} per cm in base e", all));
  if (r.resin.n > 0) out += line("refractive index", fmt::format("{:g}", r.resin.n));
  if (r.resin.inhibition_dose_mj_cm3 > 0) {
    out += line("inhibition dose", fmt::format("{:.4g} mJ/cm³, before the gel dose (tomographic)",
                                               r.resin.inhibition_dose_mj_cm3));
  }
  if (r.resin.inhibition_resupply_mj_cm3_s > 0) {
    out += line("inhibition resupply",
                fmt::format("{:.4g} mJ/cm³ a second", r.resin.inhibition_resupply_mj_cm3_s));
  }
  if (r.resin.dose_diffusion_m2_s > 0) {
    out += line("diffusion of dose",
                fmt::format("{:.4g} m²/s: {:.3g} um along each axis in a minute (tomographic)",
                            r.resin.dose_diffusion_m2_s, 1e3 * dose_spread_mm(r.resin, 60)));
  }
  if (r.resin.viscosity_pa_s > 0) {
    out += line("viscosity", fmt::format("{:.4g} Pa·s", r.resin.viscosity_pa_s));
  }
  if (std::isfinite(r.resin.inhibitor_life_s)) {
    out += line("life of inhibitor", fmt::format("{:.4g} s", r.resin.inhibitor_life_s));
  }
  if (r.resin.scatter_um2_per_um > 0) {
    out += line("scatter of light",
                fmt::format("{:g} um² per um: sigma {:.3g} um at the absorbance height (base 10)",
                            r.resin.scatter_um2_per_um,
                            std::sqrt(r.resin.scatter_um2_per_um * f.height10_um)));
  }
  if (r.resin.shrinkage.any()) {
    out += line("after printing", shrinkage_in_words(r.resin.shrinkage));
  }
  if (r.resin.has_gel_time()) {
    out += line("time to gel", gel_time_text(r.resin, 1 / f.dose_factor));
    out += line("time aimed at", gel_time_text(r.resin, 1));
  } else {
    if (gel_is_known(r)) out += dose_line("gel dose", f, r.resin, false);
    out += dose_line("dose aimed at", f, r.resin, true);
  }
  if (gel_is_known(r)) out += line("dose factor", fmt::format("{:.4g}", f.dose_factor));
  if (r.resin.bleaches()) {
    const Bleaching& b = *r.resin.bleaching;
    out += line("bleaches",
                fmt::format("to an absorbance height of {:.5g} um base e, by {:.4g} mJ/cm² of "
                            "light to 1/e",
                            units::height_e_from_10(b.absorbance_height10_um), b.dose_mj_cm2));
  }
  if (r.resin.inhibition) {
    const Inhibition& i = *r.resin.inhibition;
    out += "\nInhibition by UV light\n";
    out += line("absorbance height",
                fmt::format("{:.5g} um base e, {:.5g} um base 10", f.huv_e_um, f.huv10_um));
    out += line("beta", fmt::format("{:.4g} areal, {:.4g} volumetric", f.beta, f.beta_volumetric));
    out += line("m", fmt::format("{:g}", i.m));
    if (i.critical_dose_prime > 0) {
      out += line("gel dose", prime(i.critical_dose_prime, i.m));
    }
    out += line("dead zone from", fmt::format("UV above {:.4g} times blue", 1 / f.beta));
  }
  if (r.resin.chemistry) out += chemistry_text(*r.resin.chemistry);
  out += in_plain_words(r, f);
  return out + provenance_text(r.provenance);
}

}  // namespace slicecorr::resinctl
