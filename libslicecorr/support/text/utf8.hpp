// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Characters of texts that come from outside and need not be UTF-8.
#pragma once

#include <cstddef>
#include <string_view>

namespace slicecorr::detail {

inline constexpr char32_t kNoCharacter = 0xFFFFFFFF;

/// The character at `at`, which moves behind it; `kNoCharacter`, and one byte on, where it is no
/// UTF-8.
char32_t next_character(std::string_view text, std::size_t& at);

bool is_utf8(std::string_view text);

}  // namespace slicecorr::detail
