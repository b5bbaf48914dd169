// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/beam_vat.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "slicecorr/error.hpp"
#include "support/toml/toml_table.hpp"

namespace slicecorr {
namespace {

constexpr double kMostFocalMm = 1e5, kMostPitchUm = 1e4;
constexpr std::size_t kSides = 6;

/// `count` numbers of a list, each in (low, high], or [low, high] when `closed`.
std::vector<double> numbers(const TomlTable& table, const char* key, const toml::node& node,
                            std::size_t count, double low, double high, bool closed,
                            const std::string& expected) {
  const toml::array* const list = node.as_array();
  std::vector<double> values;
  if (list && list->size() == count) {
    for (const toml::node& item : *list) {
      const auto v = item.is_number() ? item.value<double>() : std::nullopt;
      if (!v || !std::isfinite(*v) || *v > high || (closed ? *v < low : *v <= low)) break;
      values.push_back(*v);
    }
  }
  if (values.size() != count) table.fail(key, "expected " + expected);
  return values;
}

/// A list with an item for each beam.
const toml::array& list_of(const TomlTable& table, const char* key, std::size_t ways) {
  const toml::array* const list = table.node(key)->as_array();
  if (!list || list->size() != ways) {
    table.fail(key, fmt::format("expected a list of {}, one for each side in \"from\"", ways));
  }
  return *list;
}

std::vector<BeamWay> ways_of(const TomlTable& table, const Printer& printer) {
  std::vector<BeamWay> ways;
  const toml::node* const from = table.node("from");
  if (!from)
    table.fail("from", "missing; expected a list of sides, such as [\"-x\", \"-y\", \"-z\"]");
  const toml::array* const sides = from->as_array();
  if (!sides || sides->empty() || sides->size() > kSides) {
    table.fail("from", "expected a list of 1 to 6 sides, such as [\"-x\", \"-y\", \"-z\"]");
  }
  for (const toml::node& side : *sides) {
    try {
      ways.push_back(way_of_side(side.value_or(std::string())));
    } catch (const InputError& e) {
      table.fail("from", e.what());
    }
    const BeamWay& last = ways.back();
    const auto same = std::count_if(ways.begin(), ways.end(), [&](const BeamWay& w) {
      return w.axis == last.axis && w.from_plus == last.from_plus;
    });
    if (same > 1) {
      table.fail("from",
                 fmt::format("has \"{}\" twice; expected sides that differ", side_of(last)));
    }
  }
  for (std::size_t i = 0; i < ways.size(); ++i) {
    ways[i].display = static_cast<int>(i) + 1;
    ways[i].column_px = 0.5 * printer.width_px;
    ways[i].row_px = 0.5 * printer.height_px;
  }
  if (table.has("display")) {
    const toml::array& list = list_of(table, "display", ways.size());
    for (std::size_t i = 0; i < ways.size(); ++i) {
      const auto n = list[i].is_integer() ? list[i].value<std::int64_t>() : std::nullopt;
      if (!n || *n < 1 || *n > kMostDisplays) {
        table.fail("display", fmt::format("expected whole numbers from 1 to {}", kMostDisplays));
      }
      ways[i].display = static_cast<int>(*n);
    }
  }
  if (table.has("middle_px")) {
    const toml::array& list = list_of(table, "middle_px", ways.size());
    for (std::size_t i = 0; i < ways.size(); ++i) {
      const std::string expected =
          fmt::format("[column, row] within the image of {} x {} pixels for each side",
                      printer.width_px, printer.height_px);
      const auto at = numbers(table, "middle_px", list[i], 2, 0,
                              std::max(printer.width_px, printer.height_px), true, expected);
      if (at[0] > printer.width_px || at[1] > printer.height_px) {
        table.fail("middle_px", "expected " + expected);
      }
      ways[i].column_px = at[0];
      ways[i].row_px = at[1];
    }
  }
  if (table.has("mirror")) {
    const toml::array& list = list_of(table, "mirror", ways.size());
    for (std::size_t i = 0; i < ways.size(); ++i) {
      if (!list[i].is_boolean()) table.fail("mirror", "expected true or false for each side");
      ways[i].mirror = **list[i].as_boolean();
    }
  }
  return ways;
}

std::optional<PhaseVat> phase_of(const TomlTable& table) {
  if (!table.has("focal_mm")) {
    for (const char* key : {"pitch_um", "image_mm", "levels", "stroke_turns", "fill"}) {
      if (table.has(key)) {
        table.fail(key, "is for displays that delay light; expected focal_mm, too");
      }
    }
    return std::nullopt;
  }
  PhaseVat phase;
  phase.focal_mm = table.required_number("focal_mm", 0, kMostFocalMm);
  phase.pitch_um = table.required_number("pitch_um", 0, kMostPitchUm);
  phase.levels = table.integer("levels", 2, 256, 256);
  if (const auto stroke = table.number("stroke_turns", 0, 100)) phase.stroke_turns = *stroke;
  if (const auto fill = table.number("fill", 0, 1)) phase.fill = *fill;
  if (const toml::node* at = table.node("image_mm")) {
    const auto mm = numbers(table, "image_mm", *at, 2, -kMostVatMm, kMostVatMm, true,
                            "[right, up]: two numbers, mm");
    phase.dx_mm = mm[0];
    phase.dy_mm = mm[1];
  }
  return phase;
}

}  // namespace

int BeamVat::displays() const {
  int most = 0;
  for (const BeamWay& way : ways) most = std::max(most, way.display);
  return most;
}

BeamWay way_of_side(const std::string& side) {
  BeamWay way;
  const bool good =
      side.size() == 2 && (side[0] == '-' || side[0] == '+') && side[1] >= 'x' && side[1] <= 'z';
  if (!good) {
    throw InputError(fmt::format(
        "'{}' is no side of a vat; expected -x, +x, -y, +y, -z (from below) or +z", side));
  }
  way.axis = side[1] - 'x';
  way.from_plus = side[0] == '+';
  return way;
}

std::string side_of(const BeamWay& way) {
  return std::string(way.from_plus ? "+" : "-") + "xyz"[way.axis];
}

std::optional<BeamVat> parse_beam_vat(const std::string& text, const std::string& source,
                                      const Printer& printer) {
  const toml::table root_table = parse_toml(text, source);
  const TomlTable root(root_table, source);
  const auto table = root.table("beams");
  if (!table) return std::nullopt;
  BeamVat vat;
  const toml::node* const size = table->node("vat_mm");
  const char* const expected =
      "[x, y, z]: the inside of the vat, mm, each above 0 and at most 10000";
  if (!size) table->fail("vat_mm", std::string("missing; expected ") + expected);
  const auto mm = numbers(*table, "vat_mm", *size, 3, 0, kMostVatMm, false, expected);
  std::copy(mm.begin(), mm.end(), vat.inside_mm.begin());
  vat.ways = ways_of(*table, printer);
  vat.phase = phase_of(*table);
  if (vat.phase && printer.wavelength_nm <= 0) {
    root.required_table("blue").fail(
        "wavelength_nm",
        "missing; expected it for [beams] with focal_mm, whose displays delay light");
  }
  return vat;
}

std::optional<BeamVat> load_beam_vat(const std::string& name_or_path, const Printer& printer) {
  const std::string path = find_definition(name_or_path, "printer");
  return parse_beam_vat(read_text_file(path), path, printer);
}

BeamVat plain_vat(const std::array<double, 3>& inside_mm, const std::vector<std::string>& sides,
                  const Printer& printer) {
  BeamVat vat;
  vat.inside_mm = inside_mm;
  for (const std::string& side : sides) {
    BeamWay way = way_of_side(side);
    way.display = static_cast<int>(vat.ways.size()) + 1;
    way.column_px = 0.5 * printer.width_px;
    way.row_px = 0.5 * printer.height_px;
    vat.ways.push_back(way);
  }
  return vat;
}

}  // namespace slicecorr
