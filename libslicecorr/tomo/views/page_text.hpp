// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// The files under page/, embedded when the library is built (cmake/EmbedText.cmake).
#pragma once

#include <string_view>

namespace slicecorr::tomo::detail {

// Each is named after its file.
// NOLINTBEGIN(readability-identifier-naming)
extern const std::string_view page_print_css, page_round_html, page_times_js;
// NOLINTEND(readability-identifier-naming)

}  // namespace slicecorr::tomo::detail
