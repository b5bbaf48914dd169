// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// What films tell, in words and as files.
#include <fmt/format.h>

#include <cmath>
#include <filesystem>

#include "database/toml_edit.hpp"
#include "fit/figure_text.hpp"
#include "slicecorr/light_unit.hpp"
#include "slicecorr/resins/films_fit.hpp"
#include "slicecorr/units.hpp"
#include "slicecorr/unmeasured_light.hpp"
#include "support/json/finite.hpp"

namespace slicecorr::resins {

namespace {

using Json = nlohmann::ordered_json;

constexpr std::string_view kMeasuredWith = "calipers";

std::string interval(const FilmFigure& f) {
  if (!std::isfinite(f.ci95[0])) return "unknown";
  return fmt::format("{:.4g} to {:.4g}", f.ci95[0], f.ci95[1]);
}

Json ci_json(const FilmFigure& f) {
  if (!std::isfinite(f.ci95[0])) return nullptr;
  return {f.ci95[0], f.ci95[1]};
}

/// "24 films of films.csv, 6.2 um rms: ha 151 (147 to 155) um, gel 0.81 (0.77 to 0.85) s".
std::string summary(const FilmsFit& fit) {
  return fmt::format("{} films of {}, {:.1f} um rms: ha {:.4g} ({}) um base 10, gel {:.4g} ({}) s",
                     fit.used, std::filesystem::path(fit.source).filename().string(), fit.rms_um,
                     fit.absorbance_height_um.value, interval(fit.absorbance_height_um),
                     fit.gel_s.value, interval(fit.gel_s));
}

/// As errors of a print read it: of the height, base e, and of seconds to gel.
std::string covariance_of(const FilmsFit& fit) {
  if (!std::isfinite(fit.gel_s.standard_error)) return "unknown";
  const double h = units::height_e_from_10(fit.absorbance_height_um.standard_error),
               s = fit.gel_s.value * fit.gel_s.standard_error,
               both = fit.gel_s.value * units::height_e_from_10(fit.covariance_um);
  return fmt::format("h_um, critical_dose_s: [[{:.6g}, {:.6g}], [{:.6g}, {:.6g}]]", h * h, both,
                     both, s * s);
}

}  // namespace

std::string FilmsFit::to_text() const {
  std::string out = fmt::format("{:28} {:>10}   95 %\n{:28} {:>10.5g}   {}\n{:28} {:>10.4g}   {}\n",
                                "", "value", "absorbance height, um (base 10)",
                                absorbance_height_um.value, interval(absorbance_height_um),
                                "to gel, s of full light", gel_s.value, interval(gel_s));
  for (auto l = light.rbegin(); l != light.rend(); ++l) {
    out +=
        fmt::format("{:28} {:>10.4g}   {}   {} {}\n", fmt::format("light of level {}", l->level),
                    l->share.value, interval(l->share), l->films, l->films == 1 ? "film" : "films");
  }
  out += fmt::format(
      "{} films, {:.2f} um rms from what was found; light in shares of the brightest "
      "level's\n",
      used, rms_um);
  for (const std::string& text : warnings) out += "note: " + text + "\n";
  for (const std::string& text : measure_next) out += "to measure next: " + text + "\n";
  return out;
}

std::string FilmsFit::to_json() const {
  const auto figure_json = [](const FilmFigure& f) {
    return Json{{"value", f.value}, {"ci95", ci_json(f)}};
  };
  Json j;
  j["unit"] = unit_in_files(LightUnit::brightest);
  j["absorbance_height_um"] = figure_json(absorbance_height_um);
  j["absorbance_base"] = 10;
  j["gel_s"] = figure_json(gel_s);
  j["light"] = Json::array();
  for (const FilmLevel& l : light) {
    j["light"].push_back({{"level", l.level},
                          {"share", l.share.value},
                          {"ci95", ci_json(l.share)},
                          {"films", l.films}});
  }
  j["n"] = used;
  j["rmse_um"] = rms_um;
  j["films"] = Json::array();
  j["outliers"] = Json::array();
  for (const FilmResidual& r : residuals) {
    const Json row = {{"line", r.film.line},
                      {"level", r.film.level},
                      {"exposure_s", r.film.exposure_s},
                      {"thickness_um", r.film.thickness_um},
                      {"found_um", r.found_um}};
    j[r.left_out ? "outliers" : "films"].push_back(row);
  }
  j["warnings"] = warnings;
  j["measure_next"] = measure_next;
  return j.dump(2) + "\n";
}

std::string printer_with_films(const std::string& text, const std::string& source,
                               const std::string& name, const FilmsFit& fit, double full_mw_cm2) {
  TomlEdit edit(text, source);
  edit.set("", "name", toml_text(name));
  edit.set_comment("", "name", "# With the light that films tell (resinctl calibrate).");
  const double full = full_mw_cm2 > 0 ? full_mw_cm2 : 1;
  const LightUnit unit = full_mw_cm2 > 0 ? LightUnit::mw_cm2 : LightUnit::brightest;
  std::string points, comment;
  const auto point = [&](int level, double share) {
    points +=
        fmt::format("{}[{}, {}]", points.empty() ? "" : ", ", level, toml_number(share * full));
  };
  const bool black_and_white = fit.light.size() < 2;
  if (black_and_white) {
    edit.set("display", "bit_depth", "1");
    edit.set_comment("display", "bit_depth",
                     "# No grey level was measured: nothing but black and white is shown.");
    point(0, 0);
    point(1, 1);
  } else {
    if (fit.light.front().level > 0) point(0, 0);
    for (const FilmLevel& l : fit.light) point(l.level, l.share.value);
  }
  edit.set("blue", "unit", toml_text(unit_in_files(unit)));
  edit.set("blue", "calibration", "[" + points + "]");
  edit.set_comment(
      "blue", "calibration",
      fmt::format(
          "# Grey level and light, {}, by the thickness of {} films (resinctl calibrate){}.",
          unit == LightUnit::mw_cm2
              ? fmt::format("mW/cm² at the window: shares of the {:g} mW/cm² given", full)
              : "in shares of the brightest level's",
          fit.used, fit.light.front().level > 0 ? "; black was not measured" : ""));
  edit.set("provenance", "measured_with", toml_text(kMeasuredWith));
  edit.set("provenance", "measurements", toml_text(summary(fit)));
  parse_printer(edit.text(), source);
  return edit.text();
}

std::string resin_of_films(const std::string& name, const Printer& printer, const FilmsFit& fit,
                           double full_mw_cm2) {
  const bool relative = !(full_mw_cm2 > 0);
  std::string text = fmt::format(
      "name = {}\nnotes = {}\n\n[cure]\nmodel = \"jacobs\"\nunit = {}\n", toml_text(name),
      toml_text(
          fmt::format("Measured with the printer '{}', whose file goes with it.", printer.name)),
      toml_text(unit_in_files(relative ? LightUnit::brightest : LightUnit::mw_cm2)));
  if (printer.wavelength_nm > 0) {
    text += fmt::format("wavelength_nm = {}\n", toml_number(printer.wavelength_nm));
  }
  text += fmt::format("absorbance_height_um = {}\nabsorbance_base = 10\n",
                      toml_number(fit.absorbance_height_um.value));
  text += relative ? fmt::format(
                         "# Seconds of the brightest level's light that gel a surface.\n"
                         "critical_dose_s = {}\n"
                         "# Whose full light that is.\n"
                         "display = {}\n",
                         toml_number(fit.gel_s.value), toml_text(printer.name))
                   : fmt::format(
                         "# {:.5g} s of {:g} mW/cm² gel a surface.\ncritical_dose_mj_cm2 = {}\n",
                         fit.gel_s.value, full_mw_cm2, toml_number(fit.gel_s.value * full_mw_cm2));
  text += fmt::format("\n[provenance]\nsource = {}\nmeasured_with = {}\nmeasurements = {}\n",
                      toml_text("films measured with calipers (resinctl calibrate)"),
                      toml_text(kMeasuredWith), toml_text(summary(fit)));
  if (relative) text += fmt::format("covariance = {}\n", toml_text(covariance_of(fit)));
  parse_resin(text, name + ".toml");
  return text;
}

}  // namespace slicecorr::resins
