// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "exchange/import.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <set>

#include "database/schema.hpp"
#include "database/toml_edit.hpp"
#include "exchange/csv.hpp"
#include "exchange/light_readings.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/units.hpp"
#include "support/text/ascii.hpp"
#include "support/toml/toml_table.hpp"

namespace slicecorr::resins {

namespace {

namespace fs = std::filesystem;

constexpr std::uintmax_t kMostBytes = 64U << 20;
constexpr std::array kFormats = {"auto",       "prusaslicer",     "uvtools",        "anycubic",
                                 "table",      "calibration",     "uv-calibration", "lut",
                                 "flat-field", "correction-mask", "print-file"};

std::string first_bytes(const std::string& path) {
  std::string bytes(8, '\0');
  std::ifstream in(path, std::ios::binary);
  in.read(bytes.data(), static_cast<std::streamsize>(bytes.size()));
  bytes.resize(static_cast<std::size_t>(in.gcount()));
  return bytes;
}

std::string text_of_profile(const std::string& path) {
  std::error_code ec;
  if (const auto size = fs::file_size(path, ec); !ec && size > kMostBytes) {
    throw InputError(path, "",
                     fmt::format("has {} MiB; expected a profile of at most {} MiB", size >> 20,
                                 kMostBytes >> 20));
  }
  return read_text_file(path);
}

/// Tables of what was measured are no resins yet: says which program makes one of them.
void refuse_measurements(const CsvTable& table, const std::string& path) {
  constexpr std::array<std::array<const char*, 3>, 4> kMeasured = {{
      {"cured_height_um", "cured heights", "resinctl fit"},
      {"dead_zone_um", "dead zones", "resinctl fit"},
      {"time_s", "times to gel", "resinctl fit --model gel-time"},
      {"thickness_um", "films", "resinctl calibrate"},
  }};
  for (const auto& [column, what, command] : kMeasured) {
    if (!table.has(column)) continue;
    throw InputError(path, "header",
                     fmt::format("is a table of {} that were measured ({}), not a resin; expected "
                                 "a definition or a profile. '{}' makes a resin of it",
                                 what, column, command));
  }
}

/// Which reader a file is for, by what it holds.
std::string format_of(const ImportSource& source) {
  const std::string& text = source.text;
  const auto holds = [&](const char* part) { return text.find(part) != std::string::npos; };
  if (text.starts_with("\x89PNG")) return "flat-field";
  if (text.starts_with("PK")) {
    throw InputError(source.path, "", "is an archive; expected the profile itself, as text");
  }
  if (text.find('\0') != std::string::npos) {
    throw InputError(source.path, "", "is neither text nor a PNG image");
  }
  if (holds("uvSensorData") || text.starts_with("# slicecorr testpart,flat-field")) {
    return "flat-field";
  }
  if (holds("depth_penetration_curve")) return "anycubic";
  if (holds("[sla_material:") || (holds("sla_material_settings_id") && holds("exposure_time"))) {
    return "prusaslicer";
  }
  if (holds("[cure]") || holds("[display]")) {
    throw InputError(source.path, "",
                     "is a resin or printer file already; 'resinctl add' takes it");
  }
  const std::string ending = lower_case(fs::path(source.path).extension().string());
  if (ending == ".lut") return "lut";
  if (ending == ".csv") {
    if (is_light_readings(text, source.path)) return "flat-field";
    const CsvTable table(text, source.path, CsvTable::Header::optional);
    if (table.header().size() == 1) return "lut";
    refuse_measurements(table, source.path);
    return table.has("dp_um") || table.has("ec_mj_cm2") ? "table" : "calibration";
  }
  if (const std::string display = printer_profile_in_words(text); !display.empty()) {
    throw InputError(source.path, "",
                     fmt::format("is the profile of a printer ({}), not of a resin; expected the "
                                 "profile of a resin. 'resinctl new-printer' makes a printer file",
                                 display));
  }
  return "uvtools";
}

}  // namespace

std::string stable_name_of(const std::string& text) {
  std::string name;
  for (const char c : lower_case(std::string_view(text))) {
    const bool plain = (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9');
    // A point stays inside a number or word only.
    const bool point = (c == '.' || c == '_') && !name.empty() && name.back() != '-';
    if (plain || point) {
      name += c;
    } else if (!name.empty() && name.back() != '-') {
      name += '-';
    }
  }
  if (name.size() > 100) name.resize(100);
  while (!name.empty() && (name.back() == '-' || name.back() == '.' || name.back() == '_')) {
    name.pop_back();
  }
  return name.ends_with(".toml") ? name.substr(0, name.size() - 5) : name;
}

Imported finish_resin(const ResinDraft& d, const ImportSource& source, const std::string& format) {
  std::string out = fmt::format("# Made from {} (format: {}).\n", source.file, format);
  for (const std::string& a : d.assumptions) out += "# - " + a + "\n";
  const auto text = [&](const char* key, const std::string& value) {
    if (!value.empty()) out += fmt::format("{} = {}\n", key, toml_text(value));
  };
  const auto texts = [&](const char* key, const std::vector<std::string>& values) {
    if (!values.empty()) out += fmt::format("{} = {}\n", key, toml_texts(values));
  };
  constexpr int digits = 10;
  const auto number = [&](const char* key, double value) {
    if (value != 0) out += fmt::format("{} = {}\n", key, toml_number(value, digits));
  };
  text("name", d.name);
  text("maker", d.maker);
  text("product", d.product);
  texts("aliases", d.aliases);
  texts("tags", d.tags);
  text("chemistry", d.chemistry);
  text("colour", d.colour);
  text("notes", d.notes);
  out += "\n[cure]\n";
  text("model", d.model);
  if (d.model != "gel-time") number("m", d.m);
  number("wavelength_nm", d.wavelength_nm);
  number("absorbance_height_um", d.height_e_um);
  text("absorbance_base", "e");
  number("active_absorption_per_cm", d.active_absorption_per_cm);
  number("n", d.n);
  number("inhibition_dose_mj_cm3", d.inhibition_dose_mj_cm3);
  number("inhibition_resupply_mj_cm3_s", d.inhibition_resupply_mj_cm3_s);
  number("dose_diffusion_m2_s", d.dose_diffusion_m2_s);
  number("scatter_um2_per_um", d.scatter_um2_per_um);
  number("viscosity_pa_s", d.viscosity_pa_s);
  if (d.inhibitor_life_s) out += fmt::format("inhibitor_life_s = {}\n", *d.inhibitor_life_s);
  Resin absorber;
  absorber.absorbance_height10_um = units::height10_from_e(d.height_e_um);
  absorber.active_absorption_per_cm = d.active_absorption_per_cm;
  const auto areal = [&](const char* key, double value) {
    if (value == 0) return;
    out += fmt::format("# Areal; {:.4g} mJ/cm³ volumetric.\n",
                       units::volumetric_from_areal(value, dose_height_e_um(absorber)));
    number(key, value);
  };
  areal("gel_dose_mj_cm2", d.gel_mj_cm2);
  areal("critical_dose_mj_cm2", d.aim_mj_cm2);
  number("critical_dose_prime", d.critical_dose_prime);
  number("gel_a_mj_cm2", d.gel_a);
  number("gel_b_sqrt_mw_cm2_s", d.gel_b);
  number("dose_factor", d.dose_factor);
  if (d.beta > 0) {
    out += "\n[inhibition]\n";
    number("beta", d.beta);
    number("absorbance_height_um", d.huv_um);
    text("absorbance_base", "e");
    number("m", d.inhibited_m);
    number("critical_dose_prime", d.inhibited_prime);
  }
  out += "\n[provenance]\n";
  bool has_source = false;
  for (const auto& [key, value] : d.provenance) {
    text(key.c_str(), value);
    has_source = has_source || key == "source";
  }
  if (!has_source) text("source", fmt::format("imported from {}", source.file));
  parse_resin(out, d.name + ".toml");
  return {"resin", d.name, std::move(out), d.assumptions, {}};
}

std::string resin_of_exposures(const std::vector<LayerExposure>& exposures,
                               const ImportOptions& options, ResinDraft& draft,
                               double light_share) {
  std::set<double> heights;
  for (const LayerExposure& e : exposures) heights.insert(e.layer_um);
  const double n = static_cast<double>(exposures.size());
  if (options.intensity_mw_cm2 <= 0) {
    return "a profile gives times only; expected --intensity-mw-cm2, the printer's intensity";
  }
  auto& say = draft.assumptions;
  if (options.height_um > 0) {
    draft.height_e_um = options.height_um;
    say.push_back(
        fmt::format("The absorbance height, {:g} um (base e), is the one given on the command "
                    "line, not the profile's.",
                    options.height_um));
  } else if (heights.size() < 2) {
    return fmt::format(
        "has one layer height only ({:g} um), which says nothing of the absorbance height; "
        "expected --height-um (base e)",
        heights.empty() ? 0.0 : *heights.begin());
  } else {
    double mean_x = 0, mean_y = 0, sxx = 0, sxy = 0, syy = 0;
    for (const LayerExposure& e : exposures) {
      mean_x += std::log(e.exposure_s) / n;
      mean_y += e.layer_um / n;
    }
    for (const LayerExposure& e : exposures) {
      const double x = std::log(e.exposure_s) - mean_x, y = e.layer_um - mean_y;
      sxx += x * x;
      sxy += x * y;
      syy += y * y;
    }
    if (!(sxy > 1e-9 * std::sqrt(sxx * syy)) || sxx <= 0) {
      return "its exposure times don't rise with the layer height, which gives no absorbance "
             "height; expected --height-um (base e)";
    }
    draft.height_e_um = sxy / sxx;
    say.push_back(fmt::format(
        "A weak proxy, no measurement: the absorbance height, {:.4g} um (base e), is the slope of "
        "layer height over ln(exposure) of {} presets ({:g} to {:g} um{}). It takes every layer "
        "height to be exposed with the same margin.",
        draft.height_e_um, exposures.size(), *heights.begin(), *heights.rbegin(),
        heights.size() > 2 ? fmt::format(", R² {:.3f}", sxy * sxy / (sxx * syy)) : ""));
  }
  double log_time = 0;
  for (const LayerExposure& e : exposures) {
    log_time += (std::log(e.exposure_s) - e.layer_um / draft.height_e_um) / n;
  }
  draft.aim_mj_cm2 = light_share * options.intensity_mw_cm2 * std::exp(log_time);
  say.push_back(fmt::format(
      "The intensity at the window, {:g} mW/cm², is the one given on the command line{}.",
      options.intensity_mw_cm2,
      light_share == 1 ? "" : fmt::format("; {:.4g} of it counts", light_share)));
  say.push_back(fmt::format(
      "The dose, {:.4g} mJ/cm² areal, is what the profile gives the far side of a layer. It holds "
      "a margin that nobody wrote down, so it is an upper bound of the gel dose; correction aims "
      "at it as it is, without a dose_factor.",
      draft.aim_mj_cm2));
  say.emplace_back("Intensity times time counts (m = 1), and no UV light inhibits.");
  if (options.wavelength_nm > 0) {
    draft.wavelength_nm = options.wavelength_nm;
    say.push_back(fmt::format("The wavelength, {:g} nm, is the one given on the command line.",
                              options.wavelength_nm));
  }
  std::string layers;
  for (const LayerExposure& e : exposures) {
    layers += fmt::format("{}{:g} um {:g} s", layers.empty() ? "" : ", ", e.layer_um, e.exposure_s);
  }
  draft.provenance.emplace_back("exposures", layers);
  draft.provenance.emplace_back("measurements", "none: derived from a profile's exposure times");
  return "";
}

std::vector<Imported> import_definitions(const std::string& path, const ImportOptions& options,
                                         std::vector<std::string>* left_out) {
  if (std::find(kFormats.begin(), kFormats.end(), options.format) == kFormats.end()) {
    std::string known;
    for (const char* f : kFormats) known += fmt::format("{}{}", known.empty() ? "" : ", ", f);
    throw InputError(
        fmt::format("'{}' is no format to import; expected one of {}", options.format, known));
  }
  std::vector<std::string> reasons;
  ImportSource source{path, fs::path(path).filename().string(), "", &reasons};
  std::string format = options.format;
  if (format == "auto" && is_print_file(path, first_bytes(path))) format = "print-file";
  if (format != "print-file") source.text = text_of_profile(path);
  if (format == "auto") format = format_of(source);
  std::vector<Imported> made;
  if (format == "prusaslicer") made = import_prusaslicer(source, options);
  if (format == "uvtools") made = import_key_values(source, options);
  if (format == "anycubic") made = import_anycubic(source, options);
  if (format == "table") made = import_table(source, options);
  if (format == "calibration") made = import_calibration(source, options, "blue");
  if (format == "uv-calibration") made = import_calibration(source, options, "uv");
  if (format == "lut") made = import_lookup_table(source, options);
  if (format == "flat-field") made = import_flat_field(source, options, false);
  if (format == "print-file") made = import_print_file(source, options);
  if (format == "correction-mask") made = import_flat_field(source, options, true);
  if (made.empty()) {
    throw InputError(
        path, "",
        reasons.empty() ? fmt::format("has nothing to import as {}", format) : reasons.front());
  }
  if (!options.name.empty()) {
    if (made.size() > 1) {
      throw InputError(path, "",
                       fmt::format("has {} definitions; --name is for one: narrow them with --only",
                                   made.size()));
    }
    if (!is_stable_name(options.name)) {
      throw InputError(
          fmt::format("'{}' is no name; expected lower case letters, digits, '-', '.', '_', a "
                      "letter or digit first",
                      options.name));
    }
  }
  std::set<std::string> names;
  for (const Imported& i : made) {
    if (!names.insert(i.name).second) {
      throw InputError(path, "", fmt::format("gives the name '{}' twice", i.name));
    }
  }
  if (left_out) left_out->insert(left_out->end(), reasons.begin(), reasons.end());
  return made;
}

}  // namespace slicecorr::resins
