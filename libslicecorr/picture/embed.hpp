// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What pages carry in themselves: pictures, and data that their scripts read.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "slicecorr/picture.hpp"
#include "support/page/html_page.hpp"

namespace slicecorr::detail {

using Bytes = std::vector<std::uint8_t>;

/// A picture, in the page itself, with these words below it and for those who do not see it.
page::Markup captioned_image(const ColourImage& picture, const std::string& words);

/// As a zlib stream, which `inflate` of the pages' scripts reads, of at most `most` bytes; false,
/// and early, when it takes more.
bool deflate_within(std::size_t most, const Bytes& raw, Bytes& out);
Bytes deflated(const Bytes& raw);

}  // namespace slicecorr::detail
