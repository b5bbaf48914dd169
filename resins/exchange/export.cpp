// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <fmt/format.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "exchange/import.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/kinetics.hpp"
#include "slicecorr/light_unit.hpp"
#include "slicecorr/resins/exchange.hpp"
#include "slicecorr/supports.hpp"
#include "slicecorr/units.hpp"
#include "support/json/read_json.hpp"
#include "support/text/csv.hpp"

namespace slicecorr::resins {

namespace {

using nlohmann::ordered_json;

std::string to_json(const ResinRecord& r) {
  const ResinFigures f = figures_of(r.resin);
  ordered_json j;
  j["kind"] = "resin";
  j["name"] = r.name;
  j["version"] = r.version;
  for (const auto& [key, value] : {std::pair{"maker", &r.maker},
                                   {"product", &r.product},
                                   {"chemistry", &r.chemistry},
                                   {"colour", &r.colour},
                                   {"notes", &r.notes}}) {
    if (!value->empty()) j[key] = *value;
  }
  if (!r.aliases.empty()) j["aliases"] = r.aliases;
  if (!r.tags.empty()) j["tags"] = r.tags;
  if (r.wavelength_nm > 0) j["wavelength_nm"] = r.wavelength_nm;
  j["model"] = name_of(r.resin.model);
  j["unit"] = unit_in_files(r.resin.unit);
  if (r.resin.has_gel_time()) {
    j["gel_time"] = {{"gel_a_mj_cm2", r.resin.gel_a_mj_cm2 / f.dose_factor},
                     {"gel_b_sqrt_mw_cm2_s", r.resin.gel_b_sqrt_mw_cm2_s / f.dose_factor}};
  } else {
    j["m"] = r.resin.m;
  }
  j["absorbance_height_um"] = {{"base_e", f.height_e_um}, {"base_10", f.height10_um}};
  if (const auto& b = r.resin.bleaching) {
    j["bleaching"] = {{"absorbance_height_um",
                       {{"base_e", units::height_e_from_10(b->absorbance_height10_um)},
                        {"base_10", b->absorbance_height10_um}}},
                      {"dose_mj_cm2", b->dose_mj_cm2}};
  }
  j["absorption_per_cm"] = absorption_per_cm(r.resin);
  j["active_absorption_per_cm"] = curing_absorption_per_cm(r.resin);
  if (r.resin.n > 0) j["n"] = r.resin.n;
  if (r.resin.inhibition_dose_mj_cm3 > 0) {
    j["inhibition_dose_mj_cm3"] = r.resin.inhibition_dose_mj_cm3;
  }
  if (r.resin.inhibition_resupply_mj_cm3_s > 0) {
    j["inhibition_resupply_mj_cm3_s"] = r.resin.inhibition_resupply_mj_cm3_s;
  }
  if (r.resin.dose_diffusion_m2_s > 0) j["dose_diffusion_m2_s"] = r.resin.dose_diffusion_m2_s;
  if (r.resin.scatter_um2_per_um > 0) j["scatter_um2_per_um"] = r.resin.scatter_um2_per_um;
  if (r.resin.viscosity_pa_s > 0) j["viscosity_pa_s"] = r.resin.viscosity_pa_s;
  if (std::isfinite(r.resin.inhibitor_life_s)) j["inhibitor_life_s"] = r.resin.inhibitor_life_s;
  if (r.resin.shrinkage.any()) {
    j["shrinkage"] = slicecorr::detail::own_json<ordered_json>(r.resin.shrinkage.to_json());
  }
  const auto dose = [&](double areal, double volumetric, double prime, double prime_volumetric) {
    ordered_json d;
    if (areal > 0) d["mj_cm2"] = areal;
    if (volumetric > 0) d["mj_cm3"] = volumetric;
    d["prime"] = prime;
    d["prime_volumetric"] = prime_volumetric;
    return d;
  };
  if (f.gel_prime > 0) {
    j["gel_dose"] = dose(f.gel_mj_cm2, f.gel_mj_cm3, f.gel_prime, f.gel_prime_volumetric);
  }
  if (!r.resin.has_gel_time())
    j["aim"] = dose(f.aim_mj_cm2, f.aim_mj_cm3, f.aim_prime, f.aim_prime_volumetric);
  j["dose_factor"] = f.dose_factor;
  if (r.resin.inhibition) {
    ordered_json i;
    i["beta"] = f.beta;
    i["beta_volumetric"] = f.beta_volumetric;
    i["absorbance_height_um"] = {{"base_e", f.huv_e_um}, {"base_10", f.huv10_um}};
    i["m"] = r.resin.inhibition->m;
    if (r.resin.inhibition->critical_dose_prime > 0) {
      i["critical_dose_prime"] = r.resin.inhibition->critical_dose_prime;
    }
    j["inhibition"] = std::move(i);
  }
  j["provenance"] = r.provenance;
  j["measurements"] = r.measurements;
  j["path"] = r.path;
  return j.dump(2);
}

std::string in_one_cell(const std::vector<std::string>& texts) {
  return fmt::format("{}", fmt::join(texts, std::string(1, kBetweenTexts)));
}

std::string to_csv(const ResinRecord& r) {
  const ResinFigures f = figures_of(r.resin);
  std::string head, row;
  const auto cell = [&](const char* column, const std::string& text) {
    // The first cell has no comma before it.
    const char* comma = head.empty() ? "" : ",";
    head.append(comma).append(column);
    row.append(comma).append(csv_cell(text));
  };
  const auto number = [&](const char* column, double value) {
    cell(column, value > 0 ? fmt::format("{:.10g}", value) : "");
  };
  const auto provenance = [&](const char* key) {
    const auto at = r.provenance.find(key);
    return at == r.provenance.end() ? "" : at->second;
  };
  refuse_law(r.resin, LawUse::tables);
  refuse_shrinkage(r.resin, "tables, which have no column for it");
  refuse_relative(r.resin, "a table");
  const bool kinetic = r.resin.m != 1.0;
  const bool has_gel = f.gel_prime > 0 || r.resin.has_gel_time();
  cell("resin", r.product.empty() ? r.name : r.product);
  cell("name", r.name);
  cell("maker", r.maker);
  cell("chemistry", r.chemistry);
  cell("colour", r.colour);
  cell("aliases", in_one_cell(r.aliases));
  cell("tags", in_one_cell(r.tags));
  number("wavelength_nm", r.wavelength_nm);
  number("Dp_um", f.height_e_um);
  number("Ec_mJ_cm2", f.gel_mj_cm2);
  number("m", r.resin.has_gel_time() ? 0 : r.resin.m);
  number("gel_a_mj_cm2", r.resin.gel_a_mj_cm2 / f.dose_factor);
  number("gel_b_sqrt_mw_cm2_s", r.resin.gel_b_sqrt_mw_cm2_s / f.dose_factor);
  number("critical_dose_prime", kinetic ? f.gel_prime : 0);
  number("dose_factor", has_gel ? f.dose_factor : 0);
  number("aim_mJ_cm2", has_gel ? 0 : f.aim_mj_cm2);
  number("active_absorption_per_cm", r.resin.active_absorption_per_cm);
  number("n", r.resin.n);
  number("inhibition_dose_mj_cm3", r.resin.inhibition_dose_mj_cm3);
  number("inhibition_resupply_mj_cm3_s", r.resin.inhibition_resupply_mj_cm3_s);
  number("dose_diffusion_m2_s", r.resin.dose_diffusion_m2_s);
  number("scatter_um2_per_um", r.resin.scatter_um2_per_um);
  number("viscosity_pa_s", r.resin.viscosity_pa_s);
  const double life_s = r.resin.inhibitor_life_s;
  cell("inhibitor_life_s", std::isfinite(life_s) ? fmt::format("{}", life_s) : std::string());
  number("beta", f.beta);
  number("huv_um", f.huv_e_um);
  const auto& inhibition = r.resin.inhibition;
  number("m_uv", inhibition ? inhibition->m : 0);
  number("critical_dose_prime_uv", inhibition ? inhibition->critical_dose_prime : 0);
  cell("confidence", provenance("confidence"));
  cell("source", provenance("source"));
  cell("notes", r.notes);
  return "# Dp: absorbance height, base e. Ec: gel dose, areal. Correction aims at Ec times "
         "dose_factor, or at aim_mJ_cm2.\n" +
         head + "\n" + row + "\n";
}

/// Cure times of a layer that is exposed on its own, to the dose aimed at on its far side.
std::string to_prusaslicer(const ResinRecord& r, double layer_um, double intensity_mw_cm2) {
  if (!(layer_um > 0) || !(intensity_mw_cm2 > 0)) {
    throw InputError(r.path, "",
                     fmt::format("a PrusaSlicer material holds exposure times; expected {}",
                                 layer_um > 0 ? "--intensity-mw-cm2, that of the printer"
                                              : "--layer-um and --intensity-mw-cm2"));
  }
  refuse_relative(r.resin, "a PrusaSlicer material");
  const Kinetics k = make_kinetics(r.resin, false, true);
  const double exposure_s = exposure_for_height_s(k, intensity_mw_cm2, layer_um);
  // Median over 463 presets of Prusa Research's SLA profiles (version 1.0.4): 4.4; half of them lie
  // between 2.9 and 7.6.
  constexpr double first_over_other = 4.4;
  const double first_s = first_over_other * exposure_s;
  if (!std::isfinite(exposure_s) || exposure_s > 1e5) {
    throw InfeasibleError(fmt::format(
        "{}: a layer of {:g} um would need {:.3g} s at {:g} mW/cm²; expected a thinner layer or "
        "more light",
        r.name, layer_um, exposure_s, intensity_mw_cm2));
  }
  const ResinFigures f = figures_of(r.resin);
  const std::string aim =
      r.resin.has_gel_time()
          ? fmt::format("{:.4g}/i + {:.4g}/sqrt(i) s ({:g} times the time to gel)",
                        r.resin.gel_a_mj_cm2, r.resin.gel_b_sqrt_mw_cm2_s, f.dose_factor)
          : fmt::format("D' = {:.4g} (mW/cm²)^m·s ({:g} times the gel dose), with m = {:g}",
                        f.aim_prime, f.dose_factor, r.resin.m);
  std::string out = "# Material for PrusaSlicer, of resin " + r.name + ".\n";
  out += fmt::format(
      "# - exposure_time: the dose on the far side of a layer of {:g} um reaches what correction "
      "aims at, {}, absorbance height {:.4g} um (base e), {:g} mW/cm² at the window.\n",
      layer_um, aim, f.height_e_um, intensity_mw_cm2);
  if (f.dose_factor > 1) {
    out += fmt::format(
        "#   At the gel dose alone it would be {:.4g} s: the least time, with no margin.\n",
        exposure_for_height_s(make_kinetics(r.resin, false, false), intensity_mw_cm2, layer_um));
  }
  out += fmt::format(
      "# - initial_exposure_time: {:g} times that, as profiles usually have it; it does not follow "
      "from the resin.\n",
      first_over_other);
  out +=
      "# - A file of settings: PrusaSlicer takes it with --load or File > Import > Import Config. "
      "Layer height is a print setting and not set here.\n";
  const auto setting = [&](const char* key, const std::string& value) {
    // A line end would begin another setting.
    std::string line = value;
    for (char& c : line) {
      if (c == '\n' || c == '\r') c = ' ';
    }
    if (!line.empty()) out += fmt::format("{} = {}\n", key, line);
  };
  setting("printer_technology", "SLA");
  setting("sla_material_settings_id", fmt::format("{} @{:g}", r.name, layer_um / 1000));
  setting("material_vendor", r.maker);
  if (r.colour.size() == 7 && r.colour[0] == '#') setting("material_colour", r.colour);
  setting("exposure_time", fmt::format("{:.4g}", exposure_s));
  setting("initial_exposure_time", fmt::format("{:.4g}", first_s));
  setting("initial_layer_height", fmt::format("{:g}", layer_um / 1000));
  setting("material_notes", fmt::format("resin {}, version {}", r.name, r.version));
  return out;
}

}  // namespace

std::string export_record(const ResinRecord& record, const std::string& format, double layer_um,
                          double intensity_mw_cm2) {
  if (format == "toml") return record.text;
  if (format == "json") return to_json(record) + "\n";
  if (format == "csv") return to_csv(record);
  if (format == "prusaslicer") return to_prusaslicer(record, layer_um, intensity_mw_cm2);
  throw InputError(
      fmt::format("'{}' is no format to export; expected toml, json, csv or prusaslicer", format));
}

}  // namespace slicecorr::resins
