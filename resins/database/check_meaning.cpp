// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// What the values of a definition mean together. Each of them alone is checked by validate.cpp.
#include <fmt/format.h>

#include <cmath>
#include <filesystem>
#include <optional>

#include "database/checked_file.hpp"
#include "database/flat_field.hpp"
#include "database/record_text.hpp"
#include "slicecorr/chemistry.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/kinetics.hpp"
#include "slicecorr/resins/measurements.hpp"
#include "slicecorr/uncertainty.hpp"
#include "slicecorr/units.hpp"
#include "slicecorr/unmeasured_light.hpp"

namespace slicecorr::resins {

namespace {

namespace fs = std::filesystem;

/// Of a key that stands in [cure] or at the top.
std::optional<double> of_light(const CheckedFile& definition, const char* key) {
  const auto value = definition.number("cure", key);
  return value ? value : definition.number("", key);
}

/// The height by which areal and volumetric doses convert, base e.
std::optional<double> dose_height_e(const CheckedFile& definition) {
  for (const char* key : {"active_absorption_per_cm", "absorption_per_cm"}) {
    const auto absorption = of_light(definition, key);
    if (absorption && *absorption > 0) return units::height_e_from_absorption_per_cm(*absorption);
  }
  const auto height = definition.number("cure", "absorbance_height_um");
  const toml::table* cure = definition.table("cure");
  const toml::node* base = cure ? cure->get("absorbance_base") : nullptr;
  if (!height || !(*height > 0) || !base) return std::nullopt;
  return base->is_string() && **base->as_string() == "e" ? *height
                                                         : units::height_e_from_10(*height);
}

void check_doses(CheckedFile& definition) {
  const toml::table* table = definition.table("cure");
  const toml::node* law = table ? table->get("model") : nullptr;
  // Its keys are checked when it is read.
  if (law && law->value_or(std::string()) == "gel-time") return;
  const auto gel3 = definition.number("cure", "gel_dose_mj_cm3"),
             gel2 = definition.number("cure", "gel_dose_mj_cm2");
  const auto aim3 = definition.number("cure", "critical_dose_mj_cm3"),
             aim2 = definition.number("cure", "critical_dose_mj_cm2");
  const auto factor = definition.number("cure", "dose_factor"),
             prime = definition.number("cure", "critical_dose_prime");
  const double m = definition.number("cure", "m").value_or(1.0);
  if (gel3 && gel2) {
    definition.add(definition.line_of("cure", "gel_dose_mj_cm2"), "cure.gel_dose_mj_cm2",
                   "is given beside gel_dose_mj_cm3; expected one of them");
  }
  if (aim3 && aim2) {
    definition.add(definition.line_of("cure", "critical_dose_mj_cm2"), "cure.critical_dose_mj_cm2",
                   "is given beside critical_dose_mj_cm3; expected one of them");
  }
  const bool areal = aim2 && !aim3;
  const std::string aim_key = areal ? "critical_dose_mj_cm2" : "critical_dose_mj_cm3";
  if (factor && *factor < 1) {
    definition.add(definition.line_of("cure", "dose_factor"), "cure.dose_factor",
                   fmt::format("is {:g}: correction would aim below the gel dose", *factor), true);
  }
  if (m != 1.0) {
    for (const char* key :
         {"gel_dose_mj_cm3", "gel_dose_mj_cm2", "critical_dose_mj_cm3", "critical_dose_mj_cm2"}) {
      if (definition.number("cure", key)) {
        definition.add(
            definition.line_of("cure", key), full_key("cure", key),
            fmt::format("does not count: with m = {:g} a dose is critical_dose_prime", m), true);
      }
    }
    return;
  }
  const toml::table* cure = definition.table("cure");
  const toml::node* model = cure ? cure->get("model") : nullptr;
  const bool kinetic = model && model->value_or(std::string()) == "kinetic";
  if (prime && !kinetic) {
    definition.add(definition.line_of("cure", "critical_dose_prime"), "cure.critical_dose_prime",
                   "does not count: it belongs to model = \"kinetic\"", true);
  }
  if (prime && kinetic && (aim3 || aim2)) {
    definition.add(definition.line_of("cure", "critical_dose_prime"), "cure.critical_dose_prime",
                   fmt::format("does not count beside {}", aim_key), true);
  }
  const auto base_e = dose_height_e(definition);
  if (!(aim3 || aim2) || !base_e) return;
  const double aim = aim3 ? *aim3 : *aim2 / (*base_e * 1e-4);
  const auto gel = gel3 ? gel3 : gel2 ? std::optional(*gel2 / (*base_e * 1e-4)) : std::nullopt;
  if (gel && *gel > aim) {
    definition.add(
        definition.line_of("cure", aim_key), full_key("cure", aim_key),
        fmt::format("is {:g} mJ/cm³, below the gel dose of {:g} mJ/cm³: nothing would gel", aim,
                    *gel));
  } else if (gel && factor && std::abs(aim / (*gel * *factor) - 1) > 0.01) {
    definition.add(
        definition.line_of("cure", aim_key), full_key("cure", aim_key),
        fmt::format("is {:g} mJ/cm³, but gel dose times dose_factor is {:g}; expected one of them, "
                    "or the same",
                    aim, *gel * *factor));
  } else if (!gel && factor) {
    definition.add(definition.line_of("cure", "dose_factor"), "cure.dose_factor",
                   fmt::format("does not count beside {} alone", aim_key), true);
  }
}

/// No resin that anybody measured stops light in less than some ten micrometres; in mm all numbers are that
/// small.
void check_heights(CheckedFile& definition) {
  constexpr double kLeastUm = 5;
  const char* const key = "absorbance_height_um";
  for (const char* const table : {"cure", "inhibition", "bleaching"}) {
    const auto um = definition.number(table, key);
    if (!um || !(*um > 0) || *um >= kLeastUm) continue;
    definition.add(
        definition.line_of(table, key), full_key(table, key),
        fmt::format(
            "is {:g} um, less than any resin is known to have; is it {:g} mm, which are {:g} um?",
            *um, *um, *um * 1000),
        true);
  }
}

void check_composition(CheckedFile& definition) {
  const toml::table* t = definition.table("composition");
  if (!t) return;
  double sum = 0;
  for (const auto& [key, node] : *t) {
    const double share = node.value<double>().value_or(0);
    if (share >= 0 && share <= 100) sum += share;  // others have been told
  }
  // A half for what rounding of the shares can add up to.
  if (sum > 100.5) {
    definition.add(t->source().begin.line, "composition",
                   fmt::format("adds up to {:g} wt%; expected at most 100", sum));
  }
}

void check_measurements(CheckedFile& definition) {
  const toml::table* t = definition.table("provenance");
  const toml::node* node = t ? t->get("measurements") : nullptr;
  if (!node) return;
  for (const std::string& name : csv_names(*node)) {
    const fs::path file = fs::path(definition.path).parent_path() / name;
    std::error_code ec;
    const std::size_t line = node->source().begin.line;
    if (!fs::is_regular_file(file, ec)) {
      definition.add(line, "provenance.measurements",
                     fmt::format("{} is not there; expected the file beside this one", name));
      continue;
    }
    try {
      for (const std::string& w : read_measurements({file.string()}).warnings) {
        definition.add(line, "provenance.measurements", w, true);
      }
    } catch (const Error& e) {
      definition.add(line, "provenance.measurements", e.what());
    }
  }
}

/// What errors of the fit are asked of: a text that can't be read is said here, before a print needs it.
void check_covariance(CheckedFile& definition) {
  const toml::table* t = definition.table("provenance");
  const toml::node* node = t ? t->get("covariance") : nullptr;
  if (!node || node->value_or(std::string()) == "unknown") return;
  try {
    parse_uncertainty("fit", ExposureMode::continuous, 1, {definition.text, definition.path});
  } catch (const Error& e) {
    // Of a text that is read, what is said of its numbers is the print's affair.
    const std::string_view what = e.what();
    if (what.find("provenance.covariance") == std::string_view::npos) return;
    definition.add(node->source().begin.line, "provenance.covariance",
                   fmt::format("does not tell how sure the resin is: {}", what), true);
  }
}

/// UV light only takes dose away: with a trace of it, where the exponent under inhibition counts, first
/// gel must not come sooner than without.
void check_inhibition(CheckedFile& definition) {
  if (!definition.table("inhibition")) return;
  Kinetics alone, traced;
  try {
    const Resin resin = parse_resin(definition.text, definition.path);
    if (!resin.inhibition || resin.inhibition->m == resin.m) return;
    alone = make_kinetics(resin, false, false);
    traced = make_kinetics(resin, true, false);
  } catch (const Error&) {
    return;  // said elsewhere
  }
  constexpr double kRounded = 0.9;
  for (const double blue : {10.0, 100.0}) {
    const double without = alone.critical_dose_prime / std::pow(blue, alone.m);
    const double with = traced.critical_dose_prime / std::pow(blue, traced.m);
    if (with >= kRounded * without) continue;
    definition.add(
        definition.line_of("inhibition", "m"), "inhibition.m",
        fmt::format(
            "is {:g}, and {:g} in [cure], but the gel doses do not go with them: at {:g} mW/cm² a "
            "trace of UV light would make the resin gel after {:.3g} s in place of {:.3g} s; "
            "expected a critical_dose_prime under [inhibition] that belongs to this m, or no m there",
            traced.m, alone.m, blue, with, without),
        true);
    return;
  }
}

/// The chemistry says how light dims, and whether the resin gels at all.
void check_chemistry(CheckedFile& definition) {
  const toml::table* t = definition.table("chemistry");
  if (!t) return;
  std::optional<Resin> resin;
  try {
    resin = parse_resin(definition.text, definition.path);
  } catch (const Error&) {
    return;  // said elsewhere
  }
  const Chemistry& c = *resin->chemistry;
  const double own_um = light_height_um(c);
  const double cure_um = units::height_e_from_10(resin->absorbance_height10_um);
  // Figures of files are rounded, and heights measured.
  if (std::abs(own_um / cure_um - 1) > 0.1) {
    definition.add(definition.line_of("chemistry", "absorptivity_l_mol_cm"), "chemistry",
                   fmt::format("dims light to 1/e over {:.5g} um, but [cure] says {:.5g} um: "
                               "expected other_absorption_per_cm for what is no initiator",
                               own_um, cure_um),
                   true);
  }
  if (c.initiator_mol_l <= least_initiator_mol_l(c)) {
    definition.add(definition.line_of("chemistry", "initiator_mol_l"), "chemistry.initiator_mol_l",
                   fmt::format("is {:g}: the resin never gels, because all its radicals do not use "
                               "up oxygen and inhibitor; expected more than {:g}",
                               c.initiator_mol_l, least_initiator_mol_l(c)),
                   true);
  }
  if (!c.oxygen_um2_s) {
    definition.add(t->source().begin.line, "chemistry.oxygen_diffusion_um2_s",
                   "missing, and no viscosity_pa_s to reckon it from: patterns need one of them",
                   true);
  }
}

void check_shape(CheckedFile& definition, const FlatField& field, const std::string& file,
                 std::size_t line) {
  std::optional<Printer> printer;
  try {
    printer = parse_display(definition.text, definition.path);
  } catch (const Error&) {
    return;  // said elsewhere
  }
  slicecorr::FlatField map;
  map.width_px = field.image.width_px;
  map.height_px = field.image.height_px;
  const toml::node* frame = definition.table("display")->get("flat_field_frame");
  map.of_plate = frame && frame->is_string() && **frame->as_string() == "plate";
  try {
    slicecorr::check_flat_field(map, *printer, file);
  } catch (const Error& e) {
    definition.add(line, "display.flat_field", e.what());
  }
}

void check_flat_field(CheckedFile& definition) {
  const toml::table* t = definition.table("display");
  const toml::node* node = t ? t->get("flat_field") : nullptr;
  if (!node || !node->is_string()) return;
  const std::size_t line = node->source().begin.line;
  const fs::path file = fs::path(definition.path).parent_path() / **node->as_string();
  try {
    const FlatField field = flat_field_of_png(file.string());
    // The image has 255 steps and the file's numbers four digits.
    constexpr double tolerance = 0.5 / 255 + 1e-4;
    const auto compare = [&](const char* key, double measured) {
      const auto given = definition.number("display", key);
      if (given && std::abs(*given - measured) > tolerance) {
        definition.add(
            definition.line_of("display", key), full_key("display", key),
            fmt::format("is {:g}, but {} has {:.4f}", *given, file.filename().string(), measured));
      }
    };
    compare("flat_field_least", field.least);
    compare("flat_field_mean", field.mean);
    check_shape(definition, field, file.string(), line);
  } catch (const Error& e) {
    definition.add(line, "display.flat_field", e.what());
  }
}

/// Blue and patterned UV images need a channel of the display each.
void check_projector(CheckedFile& definition) {
  const auto word = [&](std::string_view in, std::string_view key, std::string_view fallback) {
    const toml::table* t = definition.table(in);
    const toml::node* node = t ? t->get(key) : nullptr;
    return node && node->is_string() ? std::string(**node->as_string()) : std::string(fallback);
  };
  const bool patterned = word("uv", "kind", "flood") == "patterned";
  // On two displays each has its own channels.
  const toml::table* other = definition.table("uv_display");
  if (other && !patterned) {
    definition.add(other->source().begin.line, "uv_display",
                   "is given; expected kind = \"patterned\" under [uv], too");
  }
  const toml::table* t = definition.table("projector");
  if (!t) return;
  const bool shared = patterned && !other;
  if (t->contains("uv") && !shared) {
    definition.add(definition.line_of("projector", "uv"), "projector.uv",
                   "is given; expected kind = \"patterned\" under [uv], and no [uv_display]");
  }
  const std::string blue = word("projector", "blue", "blue"), uv = word("projector", "uv", "red");
  if (shared && (blue == uv || blue == "all")) {
    const std::string key = t->contains("uv") ? "uv" : "blue";
    definition.add(
        definition.line_of("projector", key), "projector." + key,
        fmt::format("puts blue and UV images into the same channel (\"{}\", \"{}\"); expected one "
                    "of its own for each",
                    blue, uv));
  }
}

/// What tomographic printing needs belongs together.
void check_tomography(CheckedFile& definition) {
  const char* const tables[] = {"vial", "optics", "rotation"};
  for (const char* missing : tables) {
    if (definition.table(missing)) continue;
    for (const char* given : tables) {
      if (const toml::table* t = definition.table(given)) {
        definition.add(t->source().begin.line, given,
                       fmt::format("is of no use without [{}]; expected [vial], [optics] and "
                                   "[rotation] together",
                                   missing),
                       true);
        return;
      }
    }
  }
  if (const toml::table* t = definition.table("bath"); t && !definition.table("vial")) {
    definition.add(t->source().begin.line, "bath",
                   "is of no use without [vial]; expected the vial that stands in it", true);
  }
  const bool cone = definition.number("optics", "half_angle_deg").value_or(0) > 0;
  const bool rays = definition.number("optics", "rays_per_pixel").value_or(1) > 1;
  if (cone != rays) {
    const char* key = cone ? "half_angle_deg" : "rays_per_pixel";
    definition.add(
        definition.line_of("optics", key), full_key("optics", key),
        cone ? "does not count with one ray per pixel; expected rays_per_pixel, such as 13"
             : "does not count without half_angle_deg: all rays are the same one",
        true);
  }
}

}  // namespace

void check_resin(CheckedFile& file) {
  check_doses(file);
  check_heights(file);
  check_composition(file);
  check_measurements(file);
  check_covariance(file);
  check_chemistry(file);
  check_inhibition(file);
}

void check_printer(CheckedFile& file) {
  check_flat_field(file);
  check_projector(file);
  check_tomography(file);
}

}  // namespace slicecorr::resins
