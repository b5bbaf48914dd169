// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Texts as parts of XML and HTML.
#pragma once

#include <string>
#include <string_view>

namespace slicecorr {

/// Markup escaped, quotes too, so that the text may stand in an element or in an attribute. Control
/// characters other than line ends and tabs, which are no XML, are left out.
std::string escape_markup(std::string_view text);

}  // namespace slicecorr
