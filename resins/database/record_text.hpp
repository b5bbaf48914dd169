// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Helpers that read the words of a record.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "slicecorr/units.hpp"
#include "support/toml/toml_plus_plus.hpp"

namespace slicecorr::resins {

/// The names that end in .csv of provenance.measurements, which is a text or a list.
std::vector<std::string> csv_names(const toml::node& measurements);

/// A provenance value as text.
std::string text_of_value(const toml::node& node);

/// A table of a file; `name` may be that of a table in a table, "lamps.blue", or empty; nullptr when it
/// is not there.
inline const toml::table* table_at(const toml::table& root, std::string_view name) {
  const toml::table* at = &root;
  while (at && !name.empty()) {
    const std::size_t dot = name.find('.');
    const toml::node* node = at->get(name.substr(0, dot));
    at = node ? node->as_table() : nullptr;
    name = dot == std::string_view::npos ? "" : name.substr(dot + 1);
  }
  return at;
}

}  // namespace slicecorr::resins
