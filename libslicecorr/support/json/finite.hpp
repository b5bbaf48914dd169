// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#pragma once

#include <cmath>
#include <nlohmann/json.hpp>

namespace slicecorr::detail {

/// A number as JSON has it: null where it is none, or infinite.
template <typename Json = nlohmann::ordered_json>
Json finite_or_null(double value) {
  return std::isfinite(value) ? Json(value) : Json(nullptr);
}

}  // namespace slicecorr::detail
