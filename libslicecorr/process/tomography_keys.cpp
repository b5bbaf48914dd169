// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "process/tomography_keys.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <string>
#include <vector>

#include "slicecorr/error.hpp"
#include "slicecorr/units.hpp"
#include "slicecorr/vial.hpp"
#include "support/text/csv.hpp"

namespace slicecorr::detail {

namespace {

/// Of heights and absorptions that mean the same: figures of three digits are off by so much.
constexpr double kRounding = 0.005;

/// A key that would change doses and is not counted, with what to do.
struct Uncounted {
  const char* key;
  const char* words;
};
template <std::size_t N>
void refuse(const TomlTable& table, const Uncounted (&keys)[N]) {
  for (const Uncounted& u : keys) {
    if (table.has(u.key)) table.fail(u.key, fmt::format("is not counted: {}", u.words));
  }
}
constexpr Uncounted kOfOptics[] = {
    {"focus_mm", "images are taken to be sharp on the plane of the axis; expected none"},
    {"window_mm", "a window's place stands in [bath]; expected window_mm there"},
    {"window_thick_mm", "a window's thickness stands in [bath]; expected wall_mm there"},
    {"n_window", "a window's index stands in [bath]; expected n_wall there"}};
constexpr Uncounted kOfRotation[] = {
    {"lit_share", "frames are taken to be lit for the whole of their step; expected none"}};
constexpr Uncounted kOfTurbidResin[] = {
    {"extinction_per_cm",
     "light that a resin sends far to the side or back is in no dose; expected what absorbs alone "
     "(absorption_per_cm), and scatter_um2_per_um for what goes on forward"},
    {"albedo", "light that a resin sends far to the side or back is in no dose; expected none"},
    {"anisotropy",
     "light that a resin sends far to the side or back is in no dose; expected none"}};

double index(const TomlTable& table, const char* key, double fallback) {
  return table.number(key, 1, 3, true).value_or(fallback);
}

Vial vial_of(const TomlTable& table) {
  Vial vial;
  vial.outer_mm = table.required_number("outer_mm", 0, 1e4);
  vial.inner_mm = table.required_number("inner_mm", 0, 1e4);
  const std::string shape = table.text("shape", "round");
  if (shape != "round") {
    table.fail("shape",
               fmt::format("is '{}', and light through flat walls that turn with the vial is "
                           "not counted; expected \"round\"",
                           shape));
  }
  vial.n_outside = index(table, "n_outside", vial.n_outside);
  vial.n_wall = index(table, "n_wall", vial.n_wall);
  vial.jacket_outer_mm = table.number("jacket_outer_mm", 0, 1e4).value_or(0);
  vial.jacket_inner_mm = table.number("jacket_inner_mm", 0, 1e4).value_or(0);
  for (const char* key : {"n_between", "n_jacket"}) {
    if (vial.jacket_outer_mm > 0 || !table.has(key)) continue;
    table.fail(key, "is of a second wall; expected jacket_outer_mm and jacket_inner_mm with it");
  }
  vial.n_between = index(table, "n_between", vial.n_between);
  vial.n_jacket = index(table, "n_jacket", vial.n_jacket);
  if (const auto wrong = wrong_vial(vial)) table.fail(wrong->key, wrong->words);
  return vial;
}

Bath bath_of(const TomlTable& table) {
  Bath bath;
  bath.window_mm = table.required_number("window_mm", 0, 1e6);
  const auto n = table.number("n", 1, 3, true);
  if (!n) table.fail("n", "missing; expected the liquid's refractive index, from 1 to 3");
  bath.n = *n;
  bath.wall_mm = table.number("wall_mm", 0, 1e4, true).value_or(0);
  bath.n_wall = index(table, "n_wall", bath.n_wall);
  return bath;
}

Optics optics_of(const TomlTable& table, const Printer& printer) {
  refuse(table, kOfOptics);
  Optics optics;
  const std::string kind = table.text("kind", "");
  if (kind != "telecentric" && kind != "pinhole") {
    table.fail("kind", fmt::format("{}; expected \"telecentric\" or \"pinhole\"",
                                   table.has("kind") ? fmt::format("is '{}'", kind) : "missing"));
  }
  optics.distance_mm = table.number("distance_mm", 0, 1e6).value_or(0);
  if (kind == "pinhole") {
    optics.kind = OpticsKind::pinhole;
    table.required_number("distance_mm", 0, 1e6);
    if (printer.vial && optics.distance_mm <= printer.vial->outside_mm()) {
      table.fail("distance_mm",
                 fmt::format("is {:g}; expected more than the vial's outer radius, {:g} mm: light "
                             "comes from outside",
                             optics.distance_mm, printer.vial->outside_mm()));
    }
  }
  optics.half_angle_deg = table.number("half_angle_deg", 0, 45, true).value_or(0);
  optics.rays_per_pixel = table.integer("rays_per_pixel", 1, 1000, 1);
  // The axis must be in the picture, the optical axis of a shifted lens need not.
  const double side_px = printer.width_px / 2.0;
  optics.axis_right_px = table.number("axis_right_px", -side_px, side_px, true).value_or(0);
  optics.axis_up_px = table.number("axis_up_px", -1e5, 1e5, true).value_or(0);
  optics.tilt_deg = table.number("tilt_deg", -45, 45, true).value_or(0);
  return optics;
}

/// The rows of a file: angle, columns to the right, and rows upwards where they are given.
std::vector<AxisWobble> wobble_of(const TomlTable& table, const std::string& file) {
  std::filesystem::path path = file;
  if (path.is_relative()) path = std::filesystem::path(table.source()).parent_path() / path;
  std::error_code ec;
  if (!std::filesystem::is_regular_file(path, ec)) {
    table.fail("wobble", fmt::format("{} is not a file that can be read", path.string()));
  }
  std::vector<AxisWobble> wobble;
  CsvReader reader =
      CsvReader::of_text(read_text_file(path.string()), path.string(), {.skip_empty_rows = true});
  bool first = true;
  for (CsvRow row; reader.next(row); first = false) {
    std::vector<double> numbers;
    for (const std::string& cell : row.cells) {
      if (const auto number = number_in_text(cell)) numbers.push_back(*number);
    }
    if (first && numbers.empty() && row.fault == CsvRow::Fault::none) continue;  // header
    if (numbers.size() != row.cells.size() || numbers.size() < 2 || numbers.size() > 3 ||
        row.fault != CsvRow::Fault::none) {
      throw InputError(path.string(), reader.place(),
                       "expected angle_deg,right_px or angle_deg,right_px,up_px");
    }
    numbers.resize(3, 0);
    const AxisWobble w{numbers[0], numbers[1], numbers[2]};
    constexpr double most_px = 1e4;
    if (!(std::abs(w.right_px) <= most_px && std::abs(w.up_px) <= most_px)) {
      throw InputError(path.string(), reader.place(),
                       fmt::format("the axis moves by [{:g}, {:g}] pixels; expected at most {:g}",
                                   w.right_px, w.up_px, most_px));
    }
    if (!(w.angle_deg >= 0 && w.angle_deg < 360) ||
        (!wobble.empty() && w.angle_deg <= wobble.back().angle_deg)) {
      throw InputError(path.string(), reader.place(),
                       fmt::format("the angle is {:g}; expected angles that rise, from 0 to below "
                                   "360",
                                   w.angle_deg));
    }
    wobble.push_back(w);
  }
  if (wobble.empty()) {
    table.fail("wobble", path.string() + " has no rows; expected angle_deg,right_px");
  }
  return wobble;
}

Rotation rotation_of(const TomlTable& table) {
  refuse(table, kOfRotation);
  Rotation rotation;
  rotation.deg_s = table.required_number("deg_s", 0, 1e5);
  const std::string direction = table.text("direction", "");
  if (direction != "clockwise" && direction != "counterclockwise") {
    table.fail("direction",
               fmt::format("{}; expected \"clockwise\" or \"counterclockwise\", as the vial turns "
                           "seen from above",
                           table.has("direction") ? fmt::format("is '{}'", direction) : "missing"));
  }
  rotation.direction =
      direction == "clockwise" ? TurnDirection::clockwise : TurnDirection::counterclockwise;
  rotation.max_fps = table.number("max_fps", 0, 1e6).value_or(0);
  if (const toml::node* wobble = table.node("wobble")) {
    if (!wobble->is_string()) table.fail("wobble", "expected the name of a .csv file");
    rotation.wobble = wobble_of(table, **wobble->as_string());
  }
  return rotation;
}

}  // namespace

void tomography_keys(const TomlTable& root, Printer& printer) {
  if (const auto vial = root.table("vial")) printer.vial = vial_of(*vial);
  if (const auto optics = root.table("optics")) printer.optics = optics_of(*optics, printer);
  if (const auto rotation = root.table("rotation")) printer.rotation = rotation_of(*rotation);
  if (const auto bath = root.table("bath")) {
    printer.bath = bath_of(*bath);
    const auto vial = root.table("vial");
    if (printer.vial && !vial->has("n_outside")) printer.vial->n_outside = printer.bath->n;
    if (const auto wrong = wrong_bath(printer)) bath->fail(wrong->key, wrong->words);
  }
}

double absorbance_height10(const TomlTable& table) {
  const double height = table.required_number("absorbance_height_um", 0, 1e7);
  const toml::node* base = table.node("absorbance_base");
  if (!base) table.fail("absorbance_base", "missing; expected 10 or \"e\"");
  if (base->is_integer() && **base->as_integer() == 10) return height;
  if (base->is_string() && **base->as_string() == "e") return units::height10_from_e(height);
  if (base->is_string() && **base->as_string() == "10") return height;
  table.fail("absorbance_base", "expected 10 or \"e\"");
}

LightKeys light_keys(const TomlTable& root, const TomlTable& cure) {
  const auto home = [&](const char* key) -> const TomlTable& {
    if (root.has(key) && cure.has(key)) {
      cure.fail(key, "is given here and at the top of the file; expected one of them");
    }
    return root.has(key) ? root : cure;
  };
  refuse(root, kOfTurbidResin);
  refuse(cure, kOfTurbidResin);
  LightKeys keys;
  const TomlTable& absorption_at = home("absorption_per_cm");
  const auto absorption = absorption_at.number("absorption_per_cm", 0, 1e6);
  if (absorption && !cure.has("absorbance_height_um")) {
    keys.height10_um = units::height10_from_e(units::height_e_from_absorption_per_cm(*absorption));
  } else {
    if (!cure.has("absorbance_height_um")) {
      cure.fail("absorbance_height_um", "missing; expected a number, or absorption_per_cm");
    }
    keys.height10_um = absorbance_height10(cure);
  }
  const double height_e_um = units::height_e_from_10(keys.height10_um);
  const double of_height = units::absorption_per_cm_from_height_e(height_e_um);
  if (absorption && std::abs(*absorption / of_height - 1) > kRounding) {
    absorption_at.fail(
        "absorption_per_cm",
        fmt::format("is {:g}, but the absorbance height of {:.5g} um in base e is {:.5g} per cm; "
                    "expected the same, or one of them",
                    *absorption, height_e_um, of_height));
  }
  const TomlTable& active_at = home("active_absorption_per_cm");
  if (const auto active = active_at.number("active_absorption_per_cm", 0, 1e6)) {
    const double whole = absorption.value_or(of_height);
    if (*active > whole * (1 + 1e-9)) {
      active_at.fail("active_absorption_per_cm",
                     fmt::format("is {:g}; expected at most the {:.5g} per cm that absorb in all",
                                 *active, whole));
    }
    if (*active < whole * (1 - 1e-9)) {
      // Of a height that was rounded the other way, too, only a part cures.
      keys.active_absorption_per_cm = std::min(*active, of_height);
    }
  }
  keys.n = home("n").number("n", 1, 3, true).value_or(0);
  keys.inhibition_dose_mj_cm3 =
      home("inhibition_dose_mj_cm3").number("inhibition_dose_mj_cm3", 0, 1e9, true).value_or(0);
  keys.inhibition_resupply_mj_cm3_s = home("inhibition_resupply_mj_cm3_s")
                                          .number("inhibition_resupply_mj_cm3_s", 0, 1e9, true)
                                          .value_or(0);
  keys.dose_diffusion_m2_s = home("dose_diffusion_m2_s")
                                 .number("dose_diffusion_m2_s", 0, kMostDiffusion, true)
                                 .value_or(0);
  keys.scatter_um2_per_um =
      home("scatter_um2_per_um").number("scatter_um2_per_um", 0, kMostScatter, true).value_or(0);
  keys.viscosity_pa_s =
      home("viscosity_pa_s").number("viscosity_pa_s", 0, kMostViscosity).value_or(0);
  keys.inhibitor_life_s = home("inhibitor_life_s").number("inhibitor_life_s", 0, kMostLifeS, true);
  return keys;
}

}  // namespace slicecorr::detail
