// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What in a text tells of a person or of a computer.
#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace slicecorr::resins {

/// "a path, '/home/jo/films.csv'" or "an e-mail address, 'jo@example.org'"; empty when there is none.
/// Addresses of pages are none, nor are units ("mW/cm²") and heights ("resin@0.05").
std::string path_or_address_in(std::string_view text);

/// The first of the names that stands in the text as a word, whatever its capitals and however short;
/// empty when none does. Names that many computers have ("root", "user") tell nothing and are passed
/// over, and so are words and units of two letters ("in", "mm"), "a" and "i", and letters beside a
/// number ("n = 12").
std::string name_in(std::string_view text, const std::vector<std::string>& names);

}  // namespace slicecorr::resins
