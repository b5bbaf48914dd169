// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// The one way to read XML, within a bound of depth.
#pragma once

#include <pugixml.hpp>
#include <string>
#include <string_view>

namespace slicecorr::detail {

/// Elements in each other that a text may have.
inline constexpr int kMostXmlDepth = 64;

/// Reads `text`, which stands in `entry` of `file`. Throws `InputError` where it is no XML, or its
/// elements are too deep in each other.
void read_xml(pugi::xml_document& document, std::string_view text, const std::string& file,
              const std::string& entry, unsigned options = pugi::parse_default);

}  // namespace slicecorr::detail
