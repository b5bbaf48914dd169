/// The style that all pages of the project share: page.css and tiles.css beside this file, embedded
/// when the library is built (cmake/EmbedText.cmake).
#pragma once

#include <string_view>

namespace slicecorr::detail {

// Each is named after its file.
// NOLINTBEGIN(readability-identifier-naming)
extern const std::string_view page_page_css, page_tiles_css;
// NOLINTEND(readability-identifier-naming)

}  // namespace slicecorr::detail
