// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What printer and resin files say for tomographic printing.
#pragma once

#include <optional>

#include "slicecorr/process.hpp"
#include "support/toml/toml_table.hpp"

namespace slicecorr::detail {

/// Reads [vial], [optics], [rotation] and [bath] where they are there. Throws `InputError` naming file, line
/// and key.
void tomography_keys(const TomlTable& root, Printer& printer);

/// How a resin takes light up and flows.
struct LightKeys {
  double height10_um = 0;  ///< base 10
  double active_absorption_per_cm = 0, n = 0;
  double inhibition_dose_mj_cm3 = 0, inhibition_resupply_mj_cm3_s = 0, dose_diffusion_m2_s = 0;
  double scatter_um2_per_um = 0, viscosity_pa_s = 0;
  std::optional<double> inhibitor_life_s;
  Turbidity turbidity;
};
/// Each key stands at the top of the file or in `cure`. Throws `InputError` naming file, line and
/// key, also where absorption and absorbance height contradict each other.
LightKeys light_keys(const TomlTable& root, const TomlTable& cure);

/// The absorbance height that a table gives, as base 10. Throws `InputError`.
double absorbance_height10(const TomlTable& table);

}  // namespace slicecorr::detail
