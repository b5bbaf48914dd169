// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file figure_text.hpp
/// Numbers in sentences.
#pragma once

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <string>

namespace slicecorr::resins {

/// Four digits; "unknown" for what is no number.
inline std::string figure(double value) {
  return std::isfinite(value) ? fmt::format("{:.4g}", value) : "unknown";
}

/// As many decimals as show two digits of its standard error.
inline std::string figure(double value, double error) {
  if (!std::isfinite(value) || !(error > 0) || !std::isfinite(error)) return figure(value);
  const double decimals = 1 - std::floor(std::log10(error));
  if (decimals > 12) return fmt::format("{:.12g}", value);
  return fmt::format("{:.{}f}", value, static_cast<int>(std::max(0.0, decimals)));
}

}  // namespace slicecorr::resins
