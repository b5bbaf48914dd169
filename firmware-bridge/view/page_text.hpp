// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// The files under view/page/, embedded when the library is built (cmake/EmbedText.cmake).
#pragma once

#include <string_view>

namespace slicecorr::bridge::detail {

// Each is named after its file.
// NOLINTBEGIN(readability-identifier-naming)
extern const std::string_view page_print_css, page_live_html, page_live_js;
// NOLINTEND(readability-identifier-naming)

}  // namespace slicecorr::bridge::detail
