// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "slicecorr/vat_window.hpp"

#include <fmt/format.h>

#include <cmath>
#include <utility>

#include "process/vat_window_keys.hpp"
#include "slicecorr/error.hpp"

namespace slicecorr {

void check_window(const FlowWindow& w) {
  for (const auto& [what, value] :
       {std::pair{"the springs of the window are", w.springs_um_per_kpa},
        {"the tension of the film is", w.film_n_m},
        {"the radius of the film is", w.film_radius_mm},
        {"the stretch of the film is", w.film_stretch_n_m},
        {"the stiffness of the arm is", w.arm_n_mm},
        {"the thickness of the rubber is", w.rubber_mm},
        {"the modulus of the rubber is", w.rubber_mpa}}) {
    if (!std::isfinite(value) || value < 0) {
      throw InputError(fmt::format("{} {:g}; expected a number above 0", what, value));
    }
  }
  const int kinds =
      (w.springs_um_per_kpa > 0 ? 1 : 0) + (w.film_n_m > 0 ? 1 : 0) + (w.rubber_mm > 0 ? 1 : 0);
  if (kinds > 1) {
    throw InputError(
        "the window is told to be two of springs, a film and rubber; expected one of them, and an arm with "
        "any");
  }
  if ((w.rubber_mm > 0) != (w.rubber_mpa > 0)) {
    throw InputError("rubber needs both its thickness and its modulus; expected both, or neither");
  }
  if ((w.film_n_m > 0) != (w.film_radius_mm > 0)) {
    throw InputError(
        "a film needs both its tension and the radius over which it is free; expected both, or neither");
  }
  if (w.film_stretch_n_m > 0 && !(w.film_n_m > 0)) {
    throw InputError("what stretches is a film; expected its tension at rest and its radius, too");
  }
}

namespace detail {

FlowWindow window_keys(const TomlTable& table) {
  constexpr double kMost = 1e9;
  FlowWindow window;
  for (const auto& [key, member] : kWindowKeys)
    window.*member = table.number(key, 0, kMost).value_or(0);
  try {
    check_window(window);
    if (!window.gives_way()) throw InputError("says nothing; expected one of its keys");
  } catch (const InputError& e) {
    table.fail(table.has("film_n_m")    ? "film_n_m"
               : table.has("rubber_mm") ? "rubber_mm"
                                        : "um_per_kpa",
               e.what());
  }
  return window;
}

}  // namespace detail

}  // namespace slicecorr
