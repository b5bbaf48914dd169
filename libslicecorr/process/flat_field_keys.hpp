// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What a printer file says of its flat-field.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "support/toml/toml_table.hpp"

namespace slicecorr::detail {

struct FlatFieldKeys {
  std::string file;
  bool of_plate = false;
  std::optional<int> reference;
};
/// Nothing when there is none. Throws `InputError` naming file, line and key.
std::optional<FlatFieldKeys> flat_field_keys(const TomlTable& display);

/// What it says of the UV lamp's: a picture as the display's, or how light falls off with the distance
/// from the middle of the display.
struct LampFieldKeys {
  std::optional<FlatFieldKeys> picture;
  struct Ring {
    double r_mm = 0, share = 0;
  };
  std::vector<Ring> rings;  ///< r rises from 0; shares above 0, at most 1
};
LampFieldKeys lamp_field_keys(const TomlTable& uv);

}  // namespace slicecorr::detail
