// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// The style that all pages of the project share, page.css and tiles.css beside this file, and what
/// their scripts share: reading packed arrays (inflate.js), cells in the round (round.js). Embedded
/// when the library is built (cmake/EmbedText.cmake).
#pragma once

#include <string_view>

namespace slicecorr::detail {

// Each is named after its file.
// NOLINTBEGIN(readability-identifier-naming)
extern const std::string_view page_page_css, page_tiles_css, page_inflate_js, page_round_js;
// NOLINTEND(readability-identifier-naming)

}  // namespace slicecorr::detail
