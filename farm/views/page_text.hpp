/// The files under views/page/, embedded when the library is built (cmake/EmbedText.cmake).
#pragma once

#include <string_view>

namespace slicecorr::farm::detail {

// Each is named after its file.
// NOLINTBEGIN(readability-identifier-naming)
extern const std::string_view page_farm_css, page_live_html, page_live_css, page_live_js;
// NOLINTEND(readability-identifier-naming)

}  // namespace slicecorr::farm::detail
