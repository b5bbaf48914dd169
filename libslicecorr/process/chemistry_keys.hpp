// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// The table [chemistry] of a resin file.
#pragma once

#include <optional>

#include "slicecorr/chemistry.hpp"
#include "support/toml/toml_table.hpp"

namespace slicecorr::detail {

/// Nothing where the file has none: a text under that name is the family alone. `viscosity_pa_s`: of
/// the resin as the rest of the file says it, 0 where it does not. Throws `InputError`.
std::optional<Chemistry> chemistry_keys(const TomlTable& root, const TomlTable& cure,
                                        double viscosity_pa_s);

}  // namespace slicecorr::detail
