// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file unmeasured_light.hpp
/// Printers whose light nobody has told yet: their file says `calibration = "to be measured"` under
/// [blue]. `parse_printer` and `load_printer`, and with them all that needs light, refuse such a
/// file and say what to measure. What needs the display alone reads it with `parse_display` or
/// `load_display` (load_display.hpp). Thread-safe.
#pragma once

#include <string>
#include <string_view>

#include "slicecorr/process.hpp"

namespace slicecorr {

/// What stands in place of a calibration that is still to be measured.
inline constexpr std::string_view kToBeMeasured = "to be measured";

/// Whether the printer has a calibration. Without one `Printer::calibration` is empty, and nothing
/// but its display may be asked for.
bool light_is_measured(const Printer& printer);

/// As `parse_printer` (process.hpp), and throws as it does, but takes printers whose light is to be
/// measured, too.
Printer parse_display(std::string_view text, const std::string& source);

/// "to be measured: ...", what to measure and how, in a few sentences.
std::string how_to_measure_light(const Printer& printer);

}  // namespace slicecorr
