// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// A definition file while it is checked: what its tables say, and what has been found.
#pragma once

#include <fmt/format.h>

#include <cstddef>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "database/record_text.hpp"
#include "database/schema.hpp"
#include "support/toml/toml_table.hpp"

namespace slicecorr::resins {

struct CheckedFile {
  const std::string& text;
  std::string path, kind;
  toml::table root;
  std::vector<Finding> found;

  void add(std::size_t line, const std::string& key, const std::string& message,
           bool warning = false) {
    found.push_back({path, static_cast<int>(line), key, message, warning});
  }
  const toml::table* table(std::string_view name) const { return table_at(root, name); }
  std::optional<double> number(std::string_view in, std::string_view key) const {
    const toml::table* t = table(in);
    const toml::node* node = t ? t->get(key) : nullptr;
    return node && node->is_number() ? node->value<double>() : std::nullopt;
  }
  std::size_t line_of(std::string_view in, std::string_view key) const {
    const toml::table* t = table(in);
    const toml::node* node = t ? t->get(key) : nullptr;
    return node ? node->source().begin.line : t ? t->source().begin.line : 0;
  }
};

/// What values of a resin mean together: doses, shares, files of measurements.
void check_resin(CheckedFile& file);
/// The same of a printer: its flat-field and its projector.
void check_printer(CheckedFile& file);

}  // namespace slicecorr::resins
