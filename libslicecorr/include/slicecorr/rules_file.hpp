// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file rules_file.hpp
/// Files that lie among definitions and are none. Thread-safe.
#pragma once

#include <string>

namespace slicecorr {

/// Whether a file says which printer and resin are for which archives (docs/slicer-plugin.md): it has a
/// [default] or a [[rule]]. False where it can't be read.
bool is_rules_file(const std::string& path);

}  // namespace slicecorr
