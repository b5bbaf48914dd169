// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What a printer file says of light that spreads.
#pragma once

#include <string>
#include <vector>

#include "slicecorr/process.hpp"
#include "support/toml/toml_table.hpp"

namespace slicecorr::detail {

struct SpreadKeys {
  std::vector<SpreadGaussian> gaussians;
  std::string file;     ///< of a picture; empty: none
  double pitch_um = 0;  ///< of the picture
};
/// `light` is [blue] or [uv]; `printer` has its display. Throws `InputError` naming file, line and
/// key, also where light would spread further than the display is wide or high.
SpreadKeys spread_keys(const TomlTable& light, const Printer& printer);

}  // namespace slicecorr::detail
