// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Numbers for people.
#pragma once

#include <fmt/format.h>

#include <cmath>
#include <string>

namespace slicecorr::resins {

/// Four significant digits without an exponent where people write none.
inline std::string figure(double value) {
  if (std::isinf(value)) return value > 0 ? "infinitely many" : "-infinity";
  const double size = std::abs(value);
  if (size >= 1000 && size < 1e7) return fmt::format("{:.0f}", value);
  return fmt::format("{:.4g}", value);
}

}  // namespace slicecorr::resins
