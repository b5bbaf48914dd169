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
#include "slicecorr/vial_outline.hpp"
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
double index(const TomlTable& table, const char* key, double fallback) {
  return table.number(key, 1, 3, true).value_or(fallback);
}

struct NumbersOfRow {
  std::vector<double> numbers;
  std::string path, place;
};
/// Rows of a CSV file of numbers, beside the file that names it.
std::vector<NumbersOfRow> numbers_of(const TomlTable& table, const char* key,
                                     const std::string& file, const char* expected) {
  std::filesystem::path path = file;
  if (path.is_relative()) path = std::filesystem::path(table.source()).parent_path() / path;
  std::error_code ec;
  if (!std::filesystem::is_regular_file(path, ec)) {
    table.fail(key, fmt::format("{} is not a file that can be read", path.string()));
  }
  std::vector<NumbersOfRow> rows;
  CsvReader reader =
      CsvReader::of_text(read_text_file(path.string()), path.string(), {.skip_empty_rows = true});
  bool first = true;
  for (CsvRow row; reader.next(row); first = false) {
    std::vector<double> numbers;
    for (const std::string& cell : row.cells) {
      if (const auto number = number_in_text(cell)) numbers.push_back(*number);
    }
    if (first && numbers.empty() && row.fault == CsvRow::Fault::none) continue;  // header
    if (numbers.size() != row.cells.size() || row.fault != CsvRow::Fault::none) {
      throw InputError(path.string(), reader.place(), std::string("expected ") + expected);
    }
    rows.push_back({std::move(numbers), path.string(), reader.place()});
  }
  return rows;
}

/// A key that is a list of lists of `count` numbers; nothing where it is not there.
std::vector<std::vector<double>> lists_of(const TomlTable& table, const char* key,
                                          std::size_t count, const char* expected) {
  const toml::node* node = table.node(key);
  std::vector<std::vector<double>> all;
  if (!node) return all;
  const auto* list = node->as_array();
  if (!list || list->empty()) table.fail(key, std::string("expected ") + expected);
  for (const auto& element : *list) {
    const auto* numbers = element.as_array();
    if (!numbers || numbers->size() != count) table.fail(key, std::string("expected ") + expected);
    std::vector<double> row;
    for (const auto& number : *numbers) {
      const auto value = number.value<double>();
      if (!number.is_number() || !std::isfinite(*value) || std::abs(*value) > 1e4) {
        table.fail(key, std::string("expected ") + expected);
      }
      row.push_back(*value);
    }
    all.push_back(std::move(row));
  }
  return all;
}

std::vector<FlatPoint> outline_of(const TomlTable& table) {
  const char* const key = "outline";
  const char* const expected = "[[x_mm, y_mm], ...] of the outer face, or a .csv file of x_mm,y_mm";
  const toml::node* node = table.node(key);
  if (!node) table.fail(key, std::string("missing; expected ") + expected);
  std::vector<FlatPoint> corners;
  if (!node->is_string()) {
    for (const std::vector<double>& row : lists_of(table, key, 2, expected)) {
      corners.push_back({row[0], row[1]});
    }
    return corners;
  }
  for (const NumbersOfRow& row : numbers_of(table, key, **node->as_string(), "x_mm,y_mm")) {
    if (row.numbers.size() != 2 || !(std::hypot(row.numbers[0], row.numbers[1]) <= 1e4)) {
      throw InputError(row.path, row.place, "expected x_mm,y_mm");
    }
    corners.push_back({row.numbers[0], row.numbers[1]});
  }
  return corners;
}

std::vector<Rod> rods_of(const TomlTable& table) {
  std::vector<Rod> rods;
  const auto add = [&](const char* key, double least, double most, const char* expected) {
    for (const std::vector<double>& row : lists_of(table, key, 4, expected)) {
      if (!(row[2] > 0) || !(row[3] >= least && row[3] <= most)) {
        table.fail(key, fmt::format("[{:g}, {:g}, {:g}, {:g}]: expected {}", row[0], row[1], row[2],
                                    row[3], expected));
      }
      rods.push_back({row[0], row[1], row[2], least > 0 ? row[3] : 0, least > 0 ? 0 : row[3]});
    }
  };
  add("glass_rods", 1, 3, "[[x_mm, y_mm, diameter_mm, index from 1 to 3], ...]");
  add("metal_rods", 0, 1, "[[x_mm, y_mm, diameter_mm, share reflected from 0 to 1], ...]");
  return rods;
}

Vial vial_of(const TomlTable& table) {
  Vial vial;
  const std::string shape = table.text("shape", "round");
  for (const VialShape s : {VialShape::round, VialShape::square, VialShape::outline}) {
    if (shape == name_of(s)) vial.shape = s;
  }
  if (shape != name_of(vial.shape)) {
    table.fail("shape",
               fmt::format("is '{}'; expected \"round\", \"square\" or \"outline\"", shape));
  }
  struct OfShapes {
    const char* key;
    bool round, square, outline;
  };
  constexpr OfShapes of_shapes[] = {
      {"outer_mm", true, false, false},        {"inner_mm", true, false, false},
      {"side_mm", false, true, false},         {"wall_mm", false, true, true},
      {"corner_mm", false, true, false},       {"outline", false, false, true},
      {"jacket_outer_mm", true, false, false}, {"jacket_inner_mm", true, false, false}};
  for (const OfShapes& of : of_shapes) {
    const bool goes = vial.shape == VialShape::round    ? of.round
                      : vial.shape == VialShape::square ? of.square
                                                        : of.outline;
    if (!goes && table.has(of.key)) {
      table.fail(of.key, fmt::format("is not of a vial of shape \"{}\"; expected none", shape));
    }
  }
  if (vial.shape == VialShape::round) {
    vial.outer_mm = table.required_number("outer_mm", 0, 1e4);
    vial.inner_mm = table.required_number("inner_mm", 0, 1e4);
  } else {
    if (vial.shape == VialShape::square) {
      vial.side_mm = table.required_number("side_mm", 0, 1e4);
      vial.corner_mm = table.number("corner_mm", 0, 1e4, true).value_or(0);
    } else {
      vial.outline = outline_of(table);
    }
    vial.wall_mm = table.required_number("wall_mm", 0, 1e4);
  }
  vial.rods = rods_of(table);
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
  if (const auto wrong = wrong_outline(vial)) table.fail(wrong->key, wrong->words);
  set_radii(vial);
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
  const char* const expected = "angle_deg,right_px or angle_deg,right_px,up_px";
  std::vector<AxisWobble> wobble;
  for (auto& [numbers, path, place] : numbers_of(table, "wobble", file, expected)) {
    if (numbers.size() < 2 || numbers.size() > 3) {
      throw InputError(path, place, std::string("expected ") + expected);
    }
    numbers.resize(3, 0);
    const AxisWobble w{numbers[0], numbers[1], numbers[2]};
    constexpr double most_px = 1e4;
    if (!(std::abs(w.right_px) <= most_px && std::abs(w.up_px) <= most_px)) {
      throw InputError(path, place,
                       fmt::format("the axis moves by [{:g}, {:g}] pixels; expected at most {:g}",
                                   w.right_px, w.up_px, most_px));
    }
    if (!(w.angle_deg >= 0 && w.angle_deg < 360) ||
        (!wobble.empty() && w.angle_deg <= wobble.back().angle_deg)) {
      throw InputError(path, place,
                       fmt::format("the angle is {:g}; expected angles that rise, from 0 to below "
                                   "360",
                                   w.angle_deg));
    }
    wobble.push_back(w);
  }
  if (wobble.empty()) {
    table.fail("wobble", file + " has no rows; expected angle_deg,right_px");
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

namespace {

/// `home` says in which table a key stands.
template <class Home>
std::optional<Turbidity> turbidity_of(const Home& home) {
  const char* const keys[] = {"extinction_per_cm", "albedo", "anisotropy"};
  if (!home(keys[0]).has(keys[0])) {
    for (const char* key : {keys[1], keys[2]}) {
      if (home(key).has(key))
        home(key).fail(key, "is of a turbid resin; expected extinction_per_cm too");
    }
    return std::nullopt;
  }
  Turbidity t;
  t.extinction_per_cm = home(keys[0]).required_number(keys[0], 0, 1e6);
  const auto albedo = home(keys[1]).number(keys[1], 0, 0.9999, true);
  if (!albedo)
    home(keys[1]).fail(keys[1], "missing; expected the share of extinction that scatters");
  t.albedo = *albedo;
  if (t.albedo == 0) return t;
  const auto g = home(keys[2]).number(keys[2], 0.9, 0.995, true);
  if (!g) {
    home(keys[2]).fail(keys[2],
                       "missing; expected the mean cosine of scattering, from 0.9 to 0.995: "
                       "what goes farther to the side is not counted");
  }
  t.anisotropy = *g;
  if (home("scatter_um2_per_um").has("scatter_um2_per_um")) {
    home(keys[0]).fail(keys[0], "stands beside scatter_um2_per_um; expected one of both");
  }
  return t;
}

}  // namespace

LightKeys light_keys(const TomlTable& root, const TomlTable& cure) {
  const auto home = [&](const char* key) -> const TomlTable& {
    if (root.has(key) && cure.has(key)) {
      cure.fail(key, "is given here and at the top of the file; expected one of them");
    }
    return root.has(key) ? root : cure;
  };
  LightKeys keys;
  const TomlTable& absorption_at = home("absorption_per_cm");
  auto absorption = absorption_at.number("absorption_per_cm", 0, 1e6);
  if (const auto turbidity = turbidity_of(home)) {
    keys.turbidity = *turbidity;
    const double left = turbidity->extinction_per_cm * (1 - turbidity->albedo);
    if (absorption && std::abs(*absorption / left - 1) > kRounding) {
      absorption_at.fail(
          "absorption_per_cm",
          fmt::format("is {:g}, but of the extinction {:g} is left after scattering; "
                      "expected the same, or extinction_per_cm and albedo alone",
                      *absorption, left));
    }
    absorption = left;
  }
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
