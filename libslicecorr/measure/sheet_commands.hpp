// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#pragma once

#include <string>
#include <vector>

namespace slicecorr::detail {

// What sheets of test parts tell people to type. Sheets are read by people who use the programs, so
// this is the one place of the library that knows their names and options.

/// A correction that leaves light's spread alone, as a spread test part needs it.
inline constexpr const char* kCorrectWithoutSpread = "slicecorr correct --spread-correction off";

/// The commands that take what was measured on a part ("comb", "staircase", "wedge", "dead-zone",
/// "flat-field", "levels", "films", "spread") from `form_file`; none for another part.
std::vector<std::string> commands_on(const std::string& part, const std::string& form_file,
                                     const std::string& printer_file,
                                     const std::string& printer_name);

/// What reads the table of a part, in a few words for a message.
std::string readers_of(const std::string& part);

}  // namespace slicecorr::detail
