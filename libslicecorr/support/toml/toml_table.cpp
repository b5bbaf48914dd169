// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "support/toml/toml_table.hpp"

#include <fmt/format.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <sstream>

#include "slicecorr/error.hpp"

namespace slicecorr {

namespace fs = std::filesystem;

unsigned TomlTable::line(std::string_view key) const {
  const toml::node* node = table_.get(key);
  return node ? node->source().begin.line : table_.source().begin.line;
}

void TomlTable::fail(std::string_view key, const std::string& message) const {
  throw InputError(source_, fmt::format("line {}: {}{}", line(key), prefix_, key), message);
}

std::optional<TomlTable> TomlTable::table(std::string_view key) const {
  const toml::node* node = table_.get(key);
  if (!node) return std::nullopt;
  if (!node->is_table()) fail(key, "expected a table");
  return TomlTable(*node->as_table(), source_, prefix_ + std::string(key) + ".");
}

TomlTable TomlTable::required_table(std::string_view key) const {
  auto t = table(key);
  if (!t) fail(key, "missing; expected a table");
  return *t;
}

std::string TomlTable::text(std::string_view key, const std::string& fallback) const {
  const toml::node* node = table_.get(key);
  if (!node) return fallback;
  if (!node->is_string()) fail(key, "expected a text in quotes");
  return **node->as_string();
}

std::optional<double> TomlTable::number(std::string_view key, double low, double high,
                                        bool closed) const {
  const toml::node* node = table_.get(key);
  if (!node) return std::nullopt;
  const auto value = node->value<double>();
  if (!value || !node->is_number()) fail(key, "expected a number");
  const bool low_fits = closed ? *value >= low : *value > low;
  if (!std::isfinite(*value) || !low_fits || *value > high) {
    fail(key, fmt::format("is {:g}; expected a number {} {:g} and at most {:g}", *value,
                          closed ? "of at least" : "above", low, high));
  }
  return value;
}

double TomlTable::required_number(std::string_view key, double low, double high) const {
  const auto value = number(key, low, high);
  if (!value) fail(key, "missing; expected a number");
  return *value;
}

int TomlTable::required_integer(std::string_view key, int low, int high) const {
  if (!has(key)) fail(key, "missing; expected a whole number");
  return integer(key, low, high, low);
}

int TomlTable::integer(std::string_view key, int low, int high, int fallback) const {
  const toml::node* node = table_.get(key);
  if (!node) return fallback;
  if (!node->is_integer()) fail(key, "expected a whole number");
  const auto value = **node->as_integer();
  if (value < low || value > high) {
    fail(key, fmt::format("is {}; expected {} to {}", value, low, high));
  }
  return static_cast<int>(value);
}

toml::table parse_toml(std::string_view text, const std::string& source) {
  try {
    return toml::parse(text, source);
  } catch (const toml::parse_error& e) {
    throw InputError(source, fmt::format("line {}", e.source().begin.line),
                     fmt::format("is not TOML: {}", e.description()));
  }
}

std::string read_text_file(const std::string& path) {
  std::error_code ec;
  if (!fs::is_regular_file(path, ec)) throw InputError(path, "", "is not a file that can be read");
  std::ifstream in(path, std::ios::binary);
  std::stringstream text;
  text << in.rdbuf();
  if (!in) throw InputError(path, "", "can't be read");
  return text.str();
}

}  // namespace slicecorr
