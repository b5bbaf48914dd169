// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/resins/record.hpp"

#include <fmt/format.h>

#include <cmath>
#include <filesystem>
#include <sstream>

#include "database/record_text.hpp"
#include "database/schema.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/light_unit.hpp"
#include "support/toml/toml_table.hpp"

namespace slicecorr::resins {

namespace fs = std::filesystem;

std::string text_of_value(const toml::node& node) {
  if (const auto* text = node.as_string()) return **text;
  if (const auto* list = node.as_array()) {
    std::string all;
    for (const auto& element : *list) all += (all.empty() ? "" : ", ") + text_of_value(element);
    return all;
  }
  std::ostringstream out;
  node.visit([&](const auto& n) { out << n; });
  return out.str();
}

std::vector<std::string> csv_names(const toml::node& measurements) {
  std::vector<std::string> names;
  const auto take = [&](const toml::node& node) {
    const auto* text = node.as_string();
    if (text && (**text).ends_with(".csv")) names.push_back(**text);
  };
  take(measurements);
  if (const auto* list = measurements.as_array()) {
    for (const auto& element : *list) take(element);
  }
  return names;
}

namespace {

/// A list of texts; empty when there is none.
std::vector<std::string> texts_of(const TomlTable& table, const char* key) {
  const toml::node* node = table.node(key);
  if (!node) return {};
  const toml::array* list = node->as_array();
  if (!list) table.fail(key, "expected a list of texts");
  std::vector<std::string> texts;
  for (const auto& element : *list) {
    const auto* text = element.as_string();
    if (!text) table.fail(key, "expected a list of texts");
    texts.push_back(**text);
  }
  return texts;
}

}  // namespace

ResinRecord parse_record(std::string_view text, const std::string& source) {
  const toml::table root_table = parse_toml(text, source);
  const TomlTable root(root_table, source);
  ResinRecord record;
  record.resin = parse_resin(text, source);
  record.name = record.resin.name;
  record.version = root.integer("version", 1, 1000000000, 1);
  record.maker = root.text("maker", "");
  record.product = root.text("product", "");
  record.chemistry =
      record.resin.chemistry ? record.resin.chemistry->family : root.text("chemistry", "");
  record.colour = root.text("colour", "");
  record.notes = root.text("notes", "");
  record.aliases = texts_of(root, "aliases");
  record.tags = texts_of(root, "tags");
  record.wavelength_nm = root.required_table("cure").number("wavelength_nm", 100, 2000).value_or(0);
  if (const auto provenance = root.table("provenance")) {
    for (const auto& [key, node] : provenance->raw()) {
      record.provenance[std::string(key.str())] = text_of_value(node);
    }
    if (const toml::node* node = provenance->node("measurements")) {
      record.measurements = csv_names(*node);
    }
  }
  record.path = source;
  record.text = std::string(text);
  return record;
}

ResinRecord load_record(const std::string& name_or_path) {
  const std::string path = find_definition(name_or_path, "resin");
  return parse_record(read_text_file(path), path);
}

ResinFigures figures_of(const Resin& resin) {
  ResinFigures f;
  f.height10_um = resin.absorbance_height10_um;
  f.height_e_um = units::height_e_from_10(f.height10_um);
  const double dose_height_um = dose_height_e_um(resin);
  f.dose_factor = resin.dose_factor > 0 ? resin.dose_factor : 1.0;
  if (resin.has_gel_time()) {
    // No dose says when such a resin gels.
  } else if (resin.m == 1.0) {
    f.aim_mj_cm3 = resin.critical_dose_mj_cm3;
    f.aim_mj_cm2 = units::areal_from_volumetric(f.aim_mj_cm3, dose_height_um);
    if (resin.gel_dose_mj_cm3 > 0) {
      f.gel_mj_cm3 = resin.gel_dose_mj_cm3;
    } else if (resin.critical_dose_prime > 0 || is_relative(resin)) {
      f.gel_mj_cm3 = f.aim_mj_cm3 / f.dose_factor;
    }
    f.gel_mj_cm2 = units::areal_from_volumetric(f.gel_mj_cm3, dose_height_um);
    // With m = 1 the analogue D' is the dose itself.
    f.gel_prime = f.gel_mj_cm2;
    f.aim_prime = f.aim_mj_cm2;
  } else {
    f.aim_prime = resin.critical_dose_prime;
    f.gel_prime = f.aim_prime / f.dose_factor;
  }
  f.gel_prime_volumetric = units::volumetric_prime_from_areal(f.gel_prime, dose_height_um, resin.m);
  f.aim_prime_volumetric = units::volumetric_prime_from_areal(f.aim_prime, dose_height_um, resin.m);
  if (resin.inhibition) {
    f.huv10_um = resin.inhibition->absorbance_height10_um;
    f.huv_e_um = units::height_e_from_10(f.huv10_um);
    f.beta = resin.inhibition->beta;
    f.beta_volumetric = units::volumetric_beta_from_areal(f.beta, f.height_e_um, f.huv_e_um);
  }
  return f;
}

}  // namespace slicecorr::resins
