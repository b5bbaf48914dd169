// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Reading TOML so that every complaint names file, line and key.
#pragma once

#include <optional>
#include <string>
#include <string_view>

#include "support/files/text_file.hpp"
#include "support/toml/toml_plus_plus.hpp"

namespace slicecorr {

/// A TOML table with the file it comes from. All functions throw `InputError`. Refers to the
/// toml::table it is made from.
class TomlTable {
 public:
  TomlTable(const toml::table& table, std::string source, std::string prefix = "")
      : table_(table), source_(std::move(source)), prefix_(std::move(prefix)) {}

  [[noreturn]] void fail(std::string_view key, const std::string& message) const;
  std::optional<TomlTable> table(std::string_view key) const;
  TomlTable required_table(std::string_view key) const;
  bool has(std::string_view key) const { return table_.get(key) != nullptr; }
  const toml::node* node(std::string_view key) const { return table_.get(key); }
  const toml::table& raw() const { return table_; }
  const std::string& source() const { return source_; }
  const std::string& prefix() const { return prefix_; }
  /// Line of the key, or of the table when it does not have the key.
  unsigned line(std::string_view key) const;

  std::string text(std::string_view key, const std::string& fallback) const;
  /// A number in (low, high], or [low, high] when `closed`; none but 0 within 1e-30 of 0, none
  /// beyond 1e30.
  std::optional<double> number(std::string_view key, double low, double high,
                               bool closed = false) const;
  double required_number(std::string_view key, double low, double high) const;
  int required_integer(std::string_view key, int low, int high) const;
  int integer(std::string_view key, int low, int high, int fallback) const;

 private:
  const toml::table& table_;
  std::string source_, prefix_;
};

/// The one way to read TOML: within bounds of depth, which the parser of the library has not for
/// names in names (`a.a.a`). Throws `InputError`.
toml::table parse_toml(std::string_view text, const std::string& source);

/// What is wrong with a text that is no TOML.
struct TomlFault {
  std::size_t line = 0;
  std::string what;
};
/// The same where a text that can't be read is no exception; says why in `fault`.
std::optional<toml::table> try_toml(std::string_view text, const std::string& source = {},
                                    TomlFault* fault = nullptr);

}  // namespace slicecorr
