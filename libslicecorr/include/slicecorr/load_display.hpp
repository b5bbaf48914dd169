// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file load_display.hpp
/// Printers for what needs their display alone: its pixels, how images lie on it, how far it reaches.
/// Thread-safe.
#pragma once

#include <string>

#include "slicecorr/unmeasured_light.hpp"

namespace slicecorr {

/// As `load_printer` (load_printer.hpp), and throws as it does, but takes printers whose light is to
/// be measured (unmeasured_light.hpp), too.
Printer load_display(const std::string& name_or_path);

}  // namespace slicecorr
