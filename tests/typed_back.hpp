// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file typed_back.hpp
/// Numbers that messages name, to be typed back as printed.
#pragma once

#include <regex>
#include <string>

namespace slicecorr::test {

inline constexpr const char* kNumber = "([0-9.]+(?:e[-+]?[0-9]+)?)";

/// What the pattern's first group holds in the text; empty where it is not found.
inline std::string text_in(const std::string& text, const std::string& pattern) {
  std::smatch found;
  return std::regex_search(text, found, std::regex(pattern)) ? found[1].str() : "";
}

}  // namespace slicecorr::test
