// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "database/flat_field.hpp"

#include <algorithm>
#include <cstdint>
#include <utility>

#include "slicecorr/error.hpp"
#include "slicecorr/load_printer.hpp"

namespace slicecorr::resins {

FlatField flat_field_of(GreyImage image, const std::string& source) {
  FlatField field;
  if (image.pixels.empty()) throw InputError(source, "", "has no pixel");
  const auto [least, greatest] = std::minmax_element(image.pixels.begin(), image.pixels.end());
  if (*greatest == 0) {
    throw InputError(source, "", "is black; expected relative intensity, white the brightest");
  }
  double sum = 0;
  for (const std::uint8_t v : image.pixels) sum += v;
  field.least = static_cast<double>(*least) / *greatest;
  field.mean = sum / static_cast<double>(image.pixels.size()) / *greatest;
  field.image = std::move(image);
  return field;
}

FlatField flat_field_of_png(const std::string& path) {
  return flat_field_of(read_flat_field_png(path), path);
}

}  // namespace slicecorr::resins
