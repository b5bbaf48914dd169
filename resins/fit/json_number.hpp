// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Numbers as JSON has them.
#pragma once

#include <cmath>
#include <nlohmann/json.hpp>

namespace slicecorr::resins {

/// JSON knows no NaN and no infinity.
inline nlohmann::ordered_json number(double value) {
  return std::isfinite(value) ? nlohmann::ordered_json(value) : nlohmann::ordered_json();
}

}  // namespace slicecorr::resins
