// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Resin files made of fits.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>

#include "database/schema.hpp"
#include "database/toml_edit.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/resins/exchange.hpp"
#include "slicecorr/units.hpp"

namespace slicecorr::resins {

namespace {

namespace fs = std::filesystem;

bool is_cure_fit(const FitResult& fit) { return kind_of(fit.model).heights; }
bool is_dead_zone_fit(const FitResult& fit) { return kind_of(fit.model).dead_zones; }

std::optional<double> parameter(const FitResult& fit, std::string_view name) {
  for (const Parameter& p : fit.parameters) {
    if (p.name == name) return p.value;
  }
  return std::nullopt;
}

double required(const FitResult& fit, std::string_view name) {
  const auto value = parameter(fit, name);
  if (!value || !std::isfinite(*value) || !(*value > 0)) {
    throw InputError(fmt::format("the {} fit has no {} above 0 that a resin file could hold",
                                 name_of(fit.model), name));
  }
  return *value;
}

std::string figure(double value) {
  return std::isfinite(value) ? fmt::format("{:.4g}", value) : "unknown";
}

/// "kinetic: R² 0.985, RMSE 12.1 um, n 36".
std::string quality_of(const FitResult& fit) {
  return fmt::format("{}: R² {}, RMSE {} um, n {}", name_of(fit.model), figure(fit.r2),
                     figure(fit.rmse_um), fit.n);
}

std::string errors_of(const FitResult& fit) {
  std::string out;
  for (const Parameter& p : fit.parameters) {
    out += fmt::format("{}{} {}", out.empty() ? "" : ", ", p.name,
                       p.fixed      ? std::string("fixed")
                       : p.at_bound ? std::string("at its bound")
                                    : figure(p.stderr_));
  }
  return out;
}

/// "h_um, dc_mj_cm2: [[4.1, 0.2], [0.2, 0.03]]", of the free parameters; what ended at a bound has no
/// variance.
std::string covariance_of(const FitResult& fit) {
  std::string names;
  std::size_t free = 0;
  std::vector<std::size_t> known;
  for (const Parameter& p : fit.parameters) {
    if (p.fixed) continue;
    if (!p.at_bound) {
      names += fmt::format("{}{}", names.empty() ? "" : ", ", p.name);
      known.push_back(free);
    }
    ++free;
  }
  if (known.empty() || fit.covariance.size() != free * free) return "unknown";
  std::string rows;
  for (const std::size_t i : known) {
    std::string row;
    for (const std::size_t j : known) {
      const double value = fit.covariance[i * free + j];
      if (!std::isfinite(value)) return "unknown";
      row += fmt::format("{}{:.6g}", row.empty() ? "" : ", ", value);
    }
    rows += fmt::format("{}[{}]", rows.empty() ? "" : ", ", row);
  }
  return fmt::format("{}: [{}]", names, rows);
}

/// A number that stands where a bound of ours stopped it is none of the resin's.
void check_bounds(const FitResult& fit) {
  for (const Parameter& p : fit.parameters) {
    if (!p.at_bound || p.bound_given) continue;
    throw InputError(fmt::format(
        "the {} fit makes no resin file: {} ended at its bound, {:.4g}, and is not what was measured; "
        "expected measurements that tell it, or a value or bounds for it that are asked for",
        name_of(fit.model), p.name, p.value));
  }
}

/// `previous`: what the text said before; nullptr for a new one.
void write_cure(TomlEdit& edit, const FitResult& fit, const ResinRecord* previous) {
  const double height_um = required(fit, "h_um");
  const auto number = [&](const char* key, double v) { edit.set("cure", key, toml_number(v)); };
  const bool jacobs = kind_of(fit.model).by_dose;
  // The new fit says what the resin needs: figures of an older one must not stand beside it.
  for (const char* key : {"critical_dose_mj_cm3", "critical_dose_mj_cm2", "gel_dose_mj_cm2"}) {
    edit.remove("cure", key);
  }
  const bool gel_time = fit.model == FitModel::gel_time;
  if (jacobs || gel_time) edit.remove("cure", "critical_dose_prime");
  if (!jacobs) edit.remove("cure", "gel_dose_mj_cm3");
  if (gel_time) {
    edit.set("cure", "model", "\"gel-time\"");
    edit.remove("cure", "m");
    for (const char* key : {"gel_a_mj_cm2", "gel_b_sqrt_mw_cm2_s"}) number(key, required(fit, key));
  } else {
    for (const char* key : {"gel_a_mj_cm2", "gel_b_sqrt_mw_cm2_s"}) edit.remove("cure", key);
    edit.set("cure", "model", jacobs ? "\"jacobs\"" : "\"kinetic\"");
    number("m", jacobs ? 1.0 : required(fit, "m"));
  }
  number("absorbance_height_um", height_um);
  edit.set("cure", "absorbance_base", "\"e\"");
  for (const char* table : {"", "cure"}) edit.remove(table, "absorption_per_cm");
  if (jacobs) {
    const double areal = required(fit, "dc_mj_cm2");
    Resin absorber;
    absorber.absorbance_height10_um = units::height10_from_e(height_um);
    if (previous) absorber.active_absorption_per_cm = previous->resin.active_absorption_per_cm;
    number("gel_dose_mj_cm3", units::volumetric_from_areal(areal, dose_height_e_um(absorber)));
    edit.set_comment("cure", "gel_dose_mj_cm3",
                     fmt::format("# Volumetric, of {:.6g} mJ/cm² areal.", areal));
  } else if (!gel_time) {
    number("critical_dose_prime", required(fit, "critical_dose_prime"));
  }
  if (fit.model == FitModel::bleaching) {
    edit.set("bleaching", "absorbance_height_um", toml_number(required(fit, "h_bleached_um")));
    edit.set("bleaching", "absorbance_base", "\"e\"");
    edit.set("bleaching", "dose_mj_cm2", toml_number(required(fit, "bleaching_dose_mj_cm2")));
  } else {
    for (const char* key : {"absorbance_height_um", "absorbance_base", "dose_mj_cm2"}) {
      edit.remove("bleaching", key);
    }
  }
  if (!edit.has("cure", "dose_factor")) number("dose_factor", kDefaultDoseFactor);
}

void write_inhibition(TomlEdit& edit, const FitResult& fit) {
  const auto number = [&](const char* key, double v) {
    edit.set("inhibition", key, toml_number(v));
  };
  number("beta", required(fit, "beta"));
  number("absorbance_height_um", required(fit, "huv_um"));
  edit.set("inhibition", "absorbance_base", "\"e\"");
  const bool joint = fit.model == FitModel::joint;
  if (const auto m = parameter(fit, joint ? "m_uv" : "m")) {
    number("m", *m);
  } else {
    // Steady dead zones say nothing of it; a joint fit with one exponent has it in [cure].
    edit.remove("inhibition", "m");
  }
  // What a dead-zone fit stood on is the cure's number.
  edit.remove("inhibition", "critical_dose_prime");
}

/// Whether a file that a record names holds what the new fits are of: then they stand in its place.
bool is_fitted_anew(const fs::path& file, bool cure, bool zone) {
  try {
    const Measurements data = read_measurements({file.string()});
    return (data.cured.empty() || cure) && (data.dead_zones.empty() || zone);
  } catch (const Error&) {
    return false;  // what can't be read stays named
  }
}

/// Files of the fits, and those of the record that other fits stand on.
std::string measurement_list(const std::vector<FitResult>& fits, const ResinRecord* previous,
                             const std::string& folder) {
  std::vector<std::string> names;
  const auto add = [&](const fs::path& file, const std::string& fallback) {
    std::string name = fallback;
    if (!folder.empty()) {
      std::error_code ec;
      const fs::path relative = fs::proximate(file, folder, ec);
      if (!ec) name = relative.generic_string();
    }
    if (std::find(names.begin(), names.end(), name) == names.end()) names.push_back(name);
  };
  const bool cure = std::any_of(fits.begin(), fits.end(), is_cure_fit);
  const bool zone = std::any_of(fits.begin(), fits.end(), is_dead_zone_fit);
  if (previous) {
    for (const std::string& name : previous->measurements) {
      const fs::path file = fs::path(previous->path).parent_path() / name;
      if (!is_fitted_anew(file, cure, zone)) add(file, name);
    }
  }
  for (const FitResult& fit : fits) {
    for (const std::string& source : fit.sources) add(source, fs::path(source).filename().string());
  }
  return toml_texts(names);
}

void check_name(const std::string& name) {
  if (!is_stable_name(name)) {
    throw InputError(
        fmt::format("'{}' is no resin name; expected lower case letters, digits, '-', '.', '_', a "
                    "letter or digit first",
                    name));
  }
}

}  // namespace

std::string record_text_from_fit(const std::string& name, const std::vector<FitResult>& fits,
                                 const ResinRecord* previous, const std::string& folder) {
  check_name(name);
  const FitResult *cure = nullptr, *zone = nullptr;
  for (const FitResult& fit : fits) {
    check_bounds(fit);
    if (is_cure_fit(fit)) cure = &fit;
    if (is_dead_zone_fit(fit)) zone = &fit;
  }
  if (!cure && !(zone && previous)) {
    throw InputError(
        "a resin file needs a fit of cured heights (jacobs, kinetic, gel-time, bleaching or joint), or a dead-zone fit "
        "of a resin that has one");
  }
  TomlEdit edit(previous ? previous->text : "", name + ".toml");
  edit.set("", "name", toml_text(name));
  if (cure) write_cure(edit, *cure, previous);
  if (zone) write_inhibition(edit, *zone);
  const auto note = [&](const std::string& key, const std::string& value) {
    edit.set("provenance", key, toml_text(value));
  };
  if (!edit.has("provenance", "source")) note("source", "fit of the measurements named below");
  edit.set("provenance", "measurements", measurement_list(fits, previous, folder));
  const auto record = [&](const FitResult& fit, const std::string& prefix) {
    note(prefix + "fit", quality_of(fit));
    note(prefix + "standard_errors", errors_of(fit));
    note(prefix + "covariance", covariance_of(fit));
  };
  if (cure) record(*cure, "");
  // A tuning was of the numbers before.
  if (cure) edit.remove("provenance", "tuning");
  if (zone && zone != cure) record(*zone, "dead_zone_");
  parse_resin(edit.text(), name + ".toml");
  return edit.text();
}

std::string record_text_with_law(const std::string& name, const CureLaw& law,
                                 const std::vector<std::pair<std::string, std::string>>& notes,
                                 const ResinRecord& previous) {
  check_name(name);
  TomlEdit edit(previous.text, name + ".toml");
  edit.set("", "name", toml_text(name));
  edit.remove("", "version");
  const bool gel_time = law.model == CureModelKind::gel_time;
  if (gel_time && previous.resin.inhibition) {
    throw InputError(previous.path, "inhibition",
                     "does not go with model = \"gel-time\"; expected --as kinetic or jacobs");
  }
  const double height_e_um = units::height_e_from_10(previous.resin.absorbance_height10_um);
  for (const char* key :
       {"m", "critical_dose_mj_cm3", "critical_dose_mj_cm2", "gel_dose_mj_cm3", "gel_dose_mj_cm2",
        "critical_dose_prime", "gel_a_mj_cm2", "gel_b_sqrt_mw_cm2_s", "absorption_per_cm"}) {
    edit.remove("cure", key);
  }
  edit.remove("", "absorption_per_cm");
  const auto figure_of = [&](const char* key, double value) {
    if (!(value > 0) || !std::isfinite(value)) {
      throw InputError(fmt::format("{} came out as {:g}; expected a number above 0", key, value));
    }
    edit.set("cure", key, toml_number(value));
  };
  edit.set("cure", "model", toml_text(name_of(law.model)));
  figure_of("absorbance_height_um", height_e_um);
  edit.set("cure", "absorbance_base", "\"e\"");
  if (gel_time) {
    figure_of("gel_a_mj_cm2", law.gel_time.A);
    figure_of("gel_b_sqrt_mw_cm2_s", law.gel_time.B);
  } else if (law.model == CureModelKind::kinetic) {
    figure_of("m", law.m);
    figure_of("critical_dose_prime", law.critical_dose_prime);
  } else {
    figure_of("gel_dose_mj_cm2", law.critical_dose_prime);
  }
  const double factor = previous.resin.has_gel_time() || previous.resin.dose_factor > 1
                            ? previous.resin.dose_factor
                            : kDefaultDoseFactor;
  figure_of("dose_factor", factor);
  for (const char* key : {"measurements", "fit", "standard_errors", "covariance"}) {
    edit.remove("provenance", key);
  }
  for (const auto& [key, text] : notes) edit.set("provenance", key, toml_text(text));
  parse_resin(edit.text(), name + ".toml");
  return edit.text();
}

}  // namespace slicecorr::resins
