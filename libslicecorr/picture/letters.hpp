// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Letters of 5 x 7 dots, for pictures of pixels.
#pragma once

#include <array>
#include <cstdint>
#include <string_view>
#include <vector>

namespace slicecorr::detail {

/// Columns from the left; the lowest bit is the upper row, the highest reaches below the line.
using Letter = std::array<std::uint8_t, 5>;

/// The letters of a text in UTF-8: ASCII, µ, ², ³; others as "?".
std::vector<Letter> letters_of(std::string_view text);

}  // namespace slicecorr::detail
