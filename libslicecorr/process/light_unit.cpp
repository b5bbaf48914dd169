// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/light_unit.hpp"

#include <fmt/format.h>

#include "process/unit_key.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/units.hpp"

namespace slicecorr {

namespace {

void refuse(const std::string& name, const char* key, LightUnit unit, const char* what) {
  if (unit == LightUnit::mw_cm2) return;
  throw InputError(
      name, key,
      fmt::format("is \"{}\"; {} counts light in mW/cm²: expected light that was measured "
                  "with a power meter (unit \"{}\")",
                  unit_in_files(unit), what, unit_in_files(LightUnit::mw_cm2)));
}

}  // namespace

LightUnit detail::unit_key(const TomlTable& table) {
  const std::string word = table.text("unit", "mW/cm2");
  for (const LightUnit unit : {LightUnit::mw_cm2, LightUnit::brightest}) {
    if (word == unit_in_files(unit)) return unit;
  }
  table.fail("unit",
             fmt::format("is '{}'; expected \"{}\" or \"{}\"", word,
                         unit_in_files(LightUnit::mw_cm2), unit_in_files(LightUnit::brightest)));
}

std::string_view unit_in_files(LightUnit unit) {
  return unit == LightUnit::mw_cm2 ? "mW/cm2" : "of the brightest level";
}

std::string_view unit_of_light(LightUnit unit) {
  return unit == LightUnit::mw_cm2 ? "mW/cm²" : "of the brightest level";
}

std::string_view unit_of_dose(LightUnit unit) {
  return unit == LightUnit::mw_cm2 ? "mJ/cm²" : "s of full light";
}

double critical_dose_s(const Resin& resin) {
  return units::areal_from_volumetric(resin.critical_dose_mj_cm3, dose_height_e_um(resin));
}

bool is_relative(const Resin& resin) { return resin.unit != LightUnit::mw_cm2; }
bool is_relative(const Printer& printer) { return printer.unit != LightUnit::mw_cm2; }

void check_same_unit(const Printer& printer, const Resin& resin) {
  if (printer.unit == resin.unit) return;
  throw InputError(fmt::format(
      "the light of printer '{}' is told in units \"{}\" (blue.unit), the dose of resin '{}' in units "
      "\"{}\" (cure.unit); expected the same of both: the two files that resinctl calibrate wrote, or "
      "two that were measured with a power meter",
      printer.name, unit_in_files(printer.unit), resin.name, unit_in_files(resin.unit)));
}

void refuse_relative(const Printer& printer, const char* what) {
  refuse(printer.name, "blue.unit", printer.unit, what);
}

void refuse_relative(const Resin& resin, const char* what) {
  refuse(resin.name, "cure.unit", resin.unit, what);
}

}  // namespace slicecorr
