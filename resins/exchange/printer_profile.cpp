// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Profiles of printers, which people take for profiles of resins: what they say of the display.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <optional>

#include "exchange/import.hpp"
#include "support/text/ascii.hpp"
#include "support/text/csv.hpp"
#include "support/text/display_text.hpp"

namespace slicecorr::resins {

namespace {

/// Keys of PrusaSlicer, Chitubox, UVtools and others for the same thing, letters and digits alone.
constexpr std::array kWidthKeys = {"displaypixelsx", "resolutionx", "machineresolutionx",
                                   "xresolution"};
constexpr std::array kHeightKeys = {"displaypixelsy", "resolutiony", "machineresolutiony",
                                    "yresolution"};
constexpr std::array kWidthMmKeys = {"displaywidth", "machinex", "bedsizex", "machinewidth"};
constexpr std::array kHeightMmKeys = {"displayheight", "machiney", "bedsizey", "machineheight"};

/// Lines `key = value` or `"key": value,`, the first of each key; keys in small letters and digits.
/// Nothing where one of them says exposure times: that is a resin's profile, whatever else is in it.
std::map<std::string, std::string> values_in(const std::string& text) {
  std::map<std::string, std::string> values;
  for (std::size_t at = 0; at < text.size();) {
    const std::size_t end = std::min(text.find('\n', at), text.size());
    const std::string_view line = std::string_view(text).substr(at, end - at);
    at = end + 1;
    const std::size_t sign = line.find_first_of("=:");
    if (sign == std::string_view::npos || line.size() > 1000) continue;
    std::string key;
    for (const char c : lower_case(line.substr(0, sign))) {
      if ((c >= 'a' && c <= 'z') || (c >= '0' && c <= '9')) key += c;
    }
    std::string value(trimmed(line.substr(sign + 1)));
    while (!value.empty() && (value.back() == ',' || value.back() == '"')) value.pop_back();
    if (value.starts_with('"')) value.erase(0, 1);
    if (is_exposure_key(key)) return {};
    values.emplace(key, value);
  }
  return values;
}

}  // namespace

std::string printer_profile_in_words(const std::string& text) {
  const auto values = values_in(text);
  const auto number = [&](const auto& keys) -> std::optional<double> {
    for (const char* key : keys) {
      const auto at = values.find(key);
      if (at == values.end()) continue;
      const auto value = number_in_text(at->second);
      if (value && *value > 0) return value;
    }
    return std::nullopt;
  };
  const auto width = number(kWidthKeys), height = number(kHeightKeys);
  if (!width || !height) return {};
  std::string words = fmt::format("{:g} x {:g} pixels", *width, *height);
  const auto width_mm = number(kWidthMmKeys), height_mm = number(kHeightMmKeys);
  if (width_mm && height_mm) {
    words +=
        fmt::format(" of {:.4g} x {:.4g} um", 1e3 * *width_mm / *width, 1e3 * *height_mm / *height);
  }
  const auto said = [&](const char* key) {
    const auto at = values.find(key);
    return at == values.end() ? std::string() : text::printable(at->second);
  };
  if (const std::string side = said("displayorientation"); !side.empty()) words += ", " + side;
  for (const auto& [key, axis] : {std::pair{"displaymirrorx", "x"}, {"displaymirrory", "y"}}) {
    if (const std::string mirror = said(key); mirror == "1" || mirror == "true") {
      words += fmt::format(", mirrored in {}", axis);
    }
  }
  return words;
}

}  // namespace slicecorr::resins
