// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Bytes in texts.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace slicecorr::detail {

/// RFC 4648, with padding, in one line.
std::string base64(const std::vector<std::uint8_t>& bytes);
/// The way back; nothing where the text is not what `base64` writes.
std::optional<std::vector<std::uint8_t>> from_base64(std::string_view text);

}  // namespace slicecorr::detail
