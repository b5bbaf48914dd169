// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "stack/formats/read_xml.hpp"

#include <fmt/format.h>

#include "slicecorr/error.hpp"

namespace slicecorr::detail {

void read_xml(pugi::xml_document& document, std::string_view text, const std::string& file,
              const std::string& entry, unsigned options) {
  const pugi::xml_parse_result result = document.load_buffer(text.data(), text.size(), options);
  if (!result) {
    throw InputError(
        file, entry,
        fmt::format("is not valid XML: {} at byte {}", result.description(), result.offset));
  }
  struct Depth final : pugi::xml_tree_walker {
    bool for_each(pugi::xml_node&) override { return depth() < kMostXmlDepth; }
  } walker;
  if (!document.traverse(walker)) {
    throw InputError(
        file, entry,
        fmt::format("is no XML that is read here: it is nested more than {} deep", kMostXmlDepth));
  }
}

}  // namespace slicecorr::detail
