// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// The files under page/, embedded when the library is built (cmake/EmbedText.cmake).
#pragma once

#include <string_view>

namespace slicecorr::detail {

// Each is named after its file.
// NOLINTBEGIN(readability-identifier-naming)
extern const std::string_view page_scan_html, page_scan_js;
// NOLINTEND(readability-identifier-naming)

}  // namespace slicecorr::detail
