/// The files under view/page/, embedded when the library is built (cmake/EmbedText.cmake).
#pragma once

#include <string_view>

namespace slicecorr::bridge::detail {

extern const std::string_view page_print_css, page_live_html, page_live_js;

}  // namespace slicecorr::bridge::detail
