// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file hook.hpp
/// A small part that no turn and no mirror brings onto itself, and resins to print it with.
#pragma once

#include <fmt/format.h>

#include <string>

#include "meshes.hpp"

namespace slicecorr::test {

/// A foot, a wall and two shelves.
inline TriangleMesh hook() {
  return box({0, 0, 0}, {2.2, 1.6, 0.4}) + box({0, 0, 0.4}, {0.6, 1.6, 3}) +
         box({0.6, 0, 1}, {2, 0.7, 1.4}) + box({0.6, 0.9, 2}, {1.6, 1.6, 2.5});
}

/// `more`: further tables.
inline std::string resin_text(const char* name, double height_um, double dose,
                              const char* more = "") {
  return fmt::format(
      "name = \"{}\"\n[cure]\nabsorbance_height_um = {}\nabsorbance_base = 10\ncritical_dose_mj_cm3 = {}\n{}",
      name, height_um, dose, more);
}

}  // namespace slicecorr::test
