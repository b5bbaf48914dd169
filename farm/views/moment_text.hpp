// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file moment_text.hpp
/// Figures, names and moments as people read them, on terminals and pages.
#pragma once

#include <cstdint>
#include <string>

#include "support/text/display_text.hpp"

namespace slicecorr::farm::text {

using namespace slicecorr::text;

/// Local time without the date where it is within half a day of `now_ms`.
std::string moment(std::int64_t ms, std::int64_t now_ms);
/// The same without seconds.
std::string to_the_minute(std::int64_t ms, std::int64_t now_ms);

/// A job's message about its inputs, "/home/lab/part.stl: 3 open edges; ...", with the files' names
/// alone.
std::string without_folders(const std::string& message);

}  // namespace slicecorr::farm::text
