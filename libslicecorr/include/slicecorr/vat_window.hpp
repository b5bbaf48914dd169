// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file vat_window.hpp
/// What the window of a vat is made of, as far as it gives way under suction (flow_window.hpp).
#pragma once

namespace slicecorr {

/// 0: not so. All are >= 0.
struct FlowWindow {
  double springs_um_per_kpa = 0;  ///< c; not with a film
  double film_n_m = 0;            ///< T, tension of the film at rest
  double film_radius_mm = 0;      ///< Rs, of its free span; with a film, > 0
  double film_stretch_n_m = 0;    ///< E t/(1 - nu²); needs a film
  double arm_n_mm = 0;            ///< k
  double rubber_mm = 0;           ///< t, thickness of rubber on glass
  double rubber_mpa = 0;          ///< E of it; with a thickness, > 0
  bool gives_way() const {
    return springs_um_per_kpa > 0 || film_n_m > 0 || arm_n_mm > 0 || rubber_mm > 0;
  }
  bool operator==(const FlowWindow&) const = default;
};
/// Throws `InputError` for two kinds at once, a film whose span is not said, or rubber without a modulus.
void check_window(const FlowWindow& window);

}  // namespace slicecorr
