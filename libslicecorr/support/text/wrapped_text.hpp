// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Long lines as terminals show them.
#pragma once

#include <cstddef>
#include <string>
#include <string_view>

namespace slicecorr {

/// Breaks lines of more than `width` characters (UTF-8) between words. What goes on stands below the
/// last word of its line that followed two spaces or more, where helps describe an option, else as
/// deep as its line. Words longer than the room stay whole; below 40 characters nothing is broken.
std::string wrapped_text(std::string_view text, std::size_t width);

}  // namespace slicecorr
