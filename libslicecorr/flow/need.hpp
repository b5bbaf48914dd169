// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What flow asks of its inputs.
#pragma once

#include <fmt/format.h>

#include "slicecorr/error.hpp"

namespace slicecorr::detail {

/// Throws `InputError` where a figure is not as expected.
inline void need(bool good, const char* what, double value, const char* expected) {
  if (!good) throw InputError("flow", what, fmt::format("{}; expected {}", value, expected));
}

}  // namespace slicecorr::detail
