// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// In what unit a file tells light.
#pragma once

#include "slicecorr/process.hpp"
#include "support/toml/toml_table.hpp"

namespace slicecorr::detail {

/// `unit` of [blue] or [cure]. Throws `InputError` naming file, line and key.
LightUnit unit_key(const TomlTable& table);

}  // namespace slicecorr::detail
