// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// The files under views/page/, embedded when the library is built (cmake/EmbedText.cmake).
#pragma once

#include <string_view>

namespace slicecorr::farm::detail {

// Each is named after its file.
// NOLINTBEGIN(readability-identifier-naming)
extern const std::string_view page_farm_css, page_lab_css, page_live_css, page_live_html,
    page_print_html, page_materials_html, page_common_js, page_live_js, page_actions_js,
    page_parts_js, page_plate_js, page_print_js, page_materials_js, page_machines_html,
    page_machines_js, page_scans_js, page_openapi_json;
// NOLINTEND(readability-identifier-naming)

}  // namespace slicecorr::farm::detail
