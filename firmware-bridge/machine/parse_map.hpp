// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#pragma once

#include <span>

#include "slicecorr/bridge/machine.hpp"
#include "support/toml/toml_table.hpp"

namespace slicecorr::bridge::detail {

/// Fails on keys that are not among `known`, offering the nearest.
void only_keys(const TomlTable& table, std::span<const std::string_view> known);

/// [modbus] of a machine of which all else is known: registers must be able to hold what it does.
RegisterMap parse_map(const TomlTable& modbus, const Machine& machine);

}  // namespace slicecorr::bridge::detail
