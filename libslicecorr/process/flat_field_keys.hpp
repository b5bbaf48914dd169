// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What a printer file says of its flat-field.
#pragma once

#include <optional>
#include <string>

#include "support/toml/toml_table.hpp"

namespace slicecorr::detail {

struct FlatFieldKeys {
  std::string file;
  bool of_plate = false;
  std::optional<int> reference;
};
/// Nothing when there is none. Throws `InputError` naming file, line and key.
std::optional<FlatFieldKeys> flat_field_keys(const TomlTable& display);

}  // namespace slicecorr::detail
