// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Tables of published working curves: Dp (absorbance height, base e) and Ec (areal gel dose).
#include <fmt/format.h>

#include <algorithm>

#include "exchange/csv.hpp"
#include "exchange/import.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/process.hpp"
#include "support/text/ascii.hpp"

namespace slicecorr::resins {

namespace {

/// What a cell lists.
std::vector<std::string> parts_of(const std::string& cell) {
  std::vector<std::string> parts;
  for (std::size_t at = 0; at < cell.size();) {
    const std::size_t end = std::min(cell.find(kBetweenTexts, at), cell.size());
    const auto part = trimmed(std::string_view(cell).substr(at, end - at));
    if (!part.empty()) parts.emplace_back(part);
    at = end + 1;
  }
  return parts;
}

}  // namespace

std::vector<Imported> import_table(const ImportSource& source, const ImportOptions& options) {
  const CsvTable table(source.text, source.path);
  for (const char* column : {"resin", "dp_um"}) {
    if (!table.has(column)) {
      throw InputError(source.path, "header",
                       fmt::format("has no column {}; expected resin, Dp_um, and Ec_mJ_cm2, "
                                   "aim_mJ_cm2 or critical_dose_prime",
                                   column));
    }
  }
  std::vector<Imported> made;
  for (const CsvTable::Row& row : table.rows()) {
    const std::string resin = table.cell(row, "resin");
    if (resin.find(options.only) == std::string::npos) continue;
    const auto number = [&](const char* column) {
      const auto value = table.number(row, column);
      if (value && !(*value > 0)) table.fail(row, column, "expected a number above 0");
      return value;
    };
    const auto height = number("dp_um"), dose = number("ec_mj_cm2"), aim = number("aim_mj_cm2");
    const auto m = number("m"), prime = number("critical_dose_prime");
    const auto gel_a = number("gel_a_mj_cm2"), gel_b = number("gel_b_sqrt_mw_cm2_s");
    if (!height || (!dose && !aim && !prime && !(gel_a && gel_b))) {
      source.leave_out(fmt::format("line {}: '{}' has no {}: that is no dose to aim at", row.line,
                                   resin, height ? "Ec_mJ_cm2" : "Dp_um"));
      continue;
    }
    ResinDraft d;
    d.wavelength_nm = number("wavelength_nm").value_or(options.wavelength_nm);
    d.name = stable_name_of(resin);
    const std::string light = fmt::format("-{:g}nm", d.wavelength_nm);
    if (d.wavelength_nm > 0 && !d.name.ends_with(light)) d.name += light;
    if (!table.cell(row, "name").empty()) d.name = table.cell(row, "name");
    if (!options.name.empty()) d.name = options.name;
    d.maker = table.cell(row, "maker");
    d.product = table.has("product") ? table.cell(row, "product") : resin;
    d.chemistry = table.cell(row, "chemistry");
    d.colour = table.cell(row, "colour");
    d.aliases = parts_of(table.cell(row, "aliases"));
    d.tags = parts_of(table.cell(row, "tags"));
    d.notes = table.cell(row, "notes");
    d.height_e_um = *height;
    if (gel_a && gel_b) {
      d.model = "gel-time";
      d.gel_a = *gel_a;
      d.gel_b = *gel_b;
      d.dose_factor = number("dose_factor").value_or(kDefaultDoseFactor);
    } else if (prime && m.value_or(1.0) != 1.0) {
      d.model = "kinetic";
      d.m = *m;
      d.critical_dose_prime = *prime;
      d.dose_factor = number("dose_factor").value_or(kDefaultDoseFactor);
    } else if (aim) {
      d.gel_mj_cm2 = dose.value_or(0);
      d.aim_mj_cm2 = *aim;
    } else {
      d.gel_mj_cm2 = *dose;
      d.dose_factor = number("dose_factor").value_or(kDefaultDoseFactor);
    }
    d.active_absorption_per_cm = number("active_absorption_per_cm").value_or(0);
    d.n = number("n").value_or(0);
    d.inhibition_dose_mj_cm3 = number("inhibition_dose_mj_cm3").value_or(0);
    d.inhibition_resupply_mj_cm3_s = number("inhibition_resupply_mj_cm3_s").value_or(0);
    d.dose_diffusion_m2_s = number("dose_diffusion_m2_s").value_or(0);
    d.scatter_um2_per_um = number("scatter_um2_per_um").value_or(0);
    d.viscosity_pa_s = number("viscosity_pa_s").value_or(0);
    if (const auto life_s = table.number(row, "inhibitor_life_s")) {
      if (!(*life_s >= 0)) table.fail(row, "inhibitor_life_s", "expected a number from 0");
      d.inhibitor_life_s = life_s;
    }
    d.beta = number("beta").value_or(0);
    d.huv_um = number("huv_um").value_or(0);
    d.inhibited_m = number("m_uv").value_or(0);
    d.inhibited_prime = number("critical_dose_prime_uv").value_or(0);
    d.assumptions.emplace_back(
        "Dp is the absorbance height in base e and Ec the areal gel dose of Jacobs' working "
        "curve.");
    if (d.dose_factor > 0 && !table.has("dose_factor")) {
      d.assumptions.push_back(
          fmt::format("Correction aims at {:g} times the gel dose, the default.", d.dose_factor));
    }
    if (d.wavelength_nm == 0) d.assumptions.emplace_back("The table gives no wavelength.");
    const std::string cited = table.cell(row, "source");
    d.provenance.emplace_back("source", cited.empty() ? "imported from " + source.file : cited);
    for (const char* column : {"confidence", "place", "date", "eoi_mj_cm2", "dose_rate_exponent",
                               "critical_conversion"}) {
      const std::string text = table.cell(row, column);
      if (!text.empty()) d.provenance.emplace_back(column, text);
    }
    d.provenance.emplace_back("measurements", "none: figures as published");
    made.push_back(finish_resin(d, source, "table"));
  }
  return made;
}

}  // namespace slicecorr::resins
