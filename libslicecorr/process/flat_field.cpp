// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <fmt/format.h>

#include <algorithm>

#include "process/flat_field_keys.hpp"
#include "slicecorr/process.hpp"

namespace slicecorr {

std::uint8_t FlatField::least() const { return *std::min_element(values->begin(), values->end()); }

std::uint8_t FlatField::greatest() const {
  return *std::max_element(values->begin(), values->end());
}

bool FlatField::operator==(const FlatField& o) const {
  return width_px == o.width_px && height_px == o.height_px && reference == o.reference &&
         of_plate == o.of_plate && (values == o.values || *values == *o.values);
}

Grid plate_grid(const Printer& printer) { return images_of(printer, {}); }

std::string light_in_words(const Printer& printer) {
  if (!printer.flat_field) return {};
  const FlatField& f = *printer.flat_field;
  return fmt::format("{:.3g} to {:.3g} % of the calibration", 100.0 * f.least() / f.reference,
                     100.0 * f.greatest() / f.reference);
}

namespace detail {

std::optional<FlatFieldKeys> flat_field_keys(const TomlTable& display) {
  const toml::node* node = display.node("flat_field");
  if (!node) {
    for (const char* key : {"flat_field_frame", "flat_field_reference"}) {
      if (display.has(key)) display.fail(key, "is given without a flat_field");
    }
    return std::nullopt;
  }
  if (!node->is_string() || (**node->as_string()).empty()) {
    display.fail("flat_field", "expected the name of a PNG file");
  }
  FlatFieldKeys keys;
  keys.file = **node->as_string();
  const std::string frame = display.text("flat_field_frame", "image");
  if (frame != "image" && frame != "plate") {
    display.fail("flat_field_frame",
                 fmt::format("is '{}'; expected \"image\" or \"plate\"", frame));
  }
  keys.of_plate = frame == "plate";
  if (display.has("flat_field_reference")) {
    keys.reference = display.required_integer("flat_field_reference", 1, 255);
  }
  return keys;
}

LampFieldKeys lamp_field_keys(const TomlTable& uv) {
  LampFieldKeys keys;
  const toml::node* node = uv.node("flat_field");
  if (!node || node->is_string()) {
    keys.picture = flat_field_keys(uv);
    return keys;
  }
  const auto fail = [&uv] {
    uv.fail(
        "flat_field",
        "expected the name of a PNG file, or [[mm from the middle, share], ...] that begins at 0 and "
        "rises, with shares above 0 and at most 1");
  };
  for (const char* key : {"flat_field_frame", "flat_field_reference"}) {
    if (uv.has(key)) uv.fail(key, "is for a picture; expected a flat_field that is one");
  }
  const toml::array* const rings = node->as_array();
  constexpr std::size_t kMostRings = 1000;
  if (!rings || rings->empty() || rings->size() > kMostRings) fail();
  for (const toml::node& ring : *rings) {
    const toml::array* const pair = ring.as_array();
    if (!pair || pair->size() != 2) fail();
    const auto r = pair->get(0)->value<double>(), share = pair->get(1)->value<double>();
    if (!r || !share || !(*share > 0) || *share > 1 || !(*r < 1e5)) fail();
    if (keys.rings.empty() ? *r != 0 : !(*r > keys.rings.back().r_mm)) fail();
    keys.rings.push_back({*r, *share});
  }
  return keys;
}

}  // namespace detail

}  // namespace slicecorr
