// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What a printer file says of its window, in [window].
#pragma once

#include <utility>

#include "slicecorr/vat_window.hpp"
#include "support/toml/toml_table.hpp"

namespace slicecorr::detail {

inline constexpr std::pair<const char*, double FlowWindow::*> kWindowKeys[] = {
    {"um_per_kpa", &FlowWindow::springs_um_per_kpa},
    {"film_n_m", &FlowWindow::film_n_m},
    {"film_radius_mm", &FlowWindow::film_radius_mm},
    {"film_stretch_n_m", &FlowWindow::film_stretch_n_m},
    {"rubber_mm", &FlowWindow::rubber_mm},
    {"rubber_mpa", &FlowWindow::rubber_mpa},
    {"arm_n_mm", &FlowWindow::arm_n_mm},
};

/// Throws `InputError` naming file, line and key.
FlowWindow window_keys(const TomlTable& table);

}  // namespace slicecorr::detail
